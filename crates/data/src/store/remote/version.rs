//! Which version of a file a server has: what its answers say of it.

use object_store::ObjectMeta;

/// What tells one version of a file from another.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Version {
    /// Length of the whole file, bytes.
    pub size: u64,
    /// Its strong ETag, where there is one: a weak one may stay while bytes change (RFC 9110, 8.8.1).
    pub e_tag: Option<String>,
    /// When it was changed, seconds since 1970; 0 where the server does not say.
    pub modified_secs: i64,
}

impl Version {
    /// What an answer says.
    pub fn of(meta: &ObjectMeta) -> Version {
        let e_tag = meta.e_tag.clone().filter(|tag| !tag.starts_with("W/"));
        Version { size: meta.size, e_tag, modified_secs: meta.last_modified.timestamp() }
    }

    /// Whether a later answer is of another version, as far as both say.
    pub fn is_other(&self, now: &Version) -> bool {
        let changed = match (&self.e_tag, &now.e_tag) {
            (Some(then), Some(now)) => then != now,
            _ => self.modified_secs != 0 && now.modified_secs != 0 && self.modified_secs != now.modified_secs,
        };
        changed || self.size != now.size
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_come_before_times_and_lengths_before_all() {
        let version =
            |size, e_tag: Option<&str>, modified_secs| Version { size, e_tag: e_tag.map(str::to_owned), modified_secs };
        let first = version(5, Some("a"), 10);
        assert!(!first.is_other(&first) && !first.is_other(&version(5, Some("a"), 11)));
        assert!(!first.is_other(&version(5, None, 10)) && !first.is_other(&version(5, None, 0)));
        for other in [version(6, Some("a"), 10), version(5, Some("b"), 10), version(5, None, 11)] {
            assert!(first.is_other(&other), "{other:?}");
        }
    }
}
