//! The show's key: 32 random bytes that every machine of a show has, in a text file of 64 hexadecimal digits.

use renetcode::generate_random_bytes;
use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The key. Who holds it may lead and follow, nobody else; it is never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct ShowKey([u8; 32]);

impl fmt::Debug for ShowKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ShowKey(..)")
    }
}

/// Why there is no key.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// The file cannot be read.
    #[error("{}: {source}; `deepfield key {}` makes a key", path.display(), path.display())]
    Read {
        /// The key file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is something else.
    #[error("{}: not a show's key: expected 64 hexadecimal digits, found {found}", path.display())]
    Text {
        /// The key file.
        path: PathBuf,
        /// What it has instead.
        found: String,
    },
    /// The file is there already.
    #[error("{}: is there already; a key is not overwritten, because others may have copies of it", path.display())]
    Exists {
        /// The key file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// The key file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

/// Bytes that are read of a key file at most.
const MOST_BYTES: u64 = 4096;

impl ShowKey {
    /// A new key from the system's randomness.
    pub fn random() -> ShowKey {
        ShowKey(generate_random_bytes())
    }

    /// The key itself.
    pub(super) fn bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// Reads a key file; white space is of no account.
    ///
    /// # Errors
    /// [`KeyError::Read`] and [`KeyError::Text`], which says nothing of what the file holds.
    pub fn read(path: &Path) -> Result<ShowKey, KeyError> {
        use std::io::Read;
        let mut text = Vec::new();
        let read = std::fs::File::open(path).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut text));
        read.map_err(|source| KeyError::Read { path: path.to_owned(), source })?;
        let wrong = |found: String| KeyError::Text { path: path.to_owned(), found };
        let digits: Option<Vec<u8>> = text
            .iter()
            .filter(|byte| !byte.is_ascii_whitespace())
            .map(|&byte| char::from(byte).to_digit(16).map(|digit| digit as u8))
            .collect();
        let digits = digits.ok_or_else(|| wrong("other characters".to_owned()))?;
        if digits.len() != 64 {
            return Err(wrong(format!("{} digits", digits.len())));
        }
        let mut key = [0; 32];
        for (byte, pair) in key.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = pair[0] << 4 | pair[1];
        }
        Ok(ShowKey(key))
    }

    /// Writes a key file that only its owner may read, where there is none yet.
    ///
    /// # Errors
    /// [`KeyError::Exists`] and [`KeyError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), KeyError> {
        let mut options = std::fs::OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let fail = |source: std::io::Error| match source.kind() {
            std::io::ErrorKind::AlreadyExists => KeyError::Exists { path: path.to_owned() },
            _ => KeyError::Write { path: path.to_owned(), source },
        };
        let digits: String = self.0.iter().map(|byte| format!("{byte:02x}")).collect();
        let mut file = options.open(path).map_err(fail)?;
        file.write_all(format!("{digits}\n").as_bytes()).and_then(|()| file.sync_all()).map_err(fail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_kept_once_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("show.key");
        let key = ShowKey::random();
        assert!(matches!(ShowKey::read(&path), Err(KeyError::Read { .. })));
        key.write(&path).unwrap();
        assert_eq!(ShowKey::read(&path).unwrap(), key);
        assert!(ShowKey::random() != key);
        assert!(matches!(ShowKey::random().write(&path), Err(KeyError::Exists { .. })));
        assert_eq!(ShowKey::read(&path).unwrap(), key, "what is there stays");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        }
        assert!(!format!("{key:?}").contains(std::fs::read_to_string(&path).unwrap().trim()));
    }

    #[test]
    fn other_files_are_no_keys() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("show.key");
        let digits = "0123456789abcdefABCDEF0123456789".repeat(2);
        for (text, is_key) in [
            (digits.clone(), true),
            (format!("  {}\r\n{}\n", &digits[..32], &digits[32..]), true),
            (digits[..63].to_owned(), false),
            (format!("{digits}0"), false),
            (format!("{}g", &digits[..63]), false),
            (String::new(), false),
            ("0".repeat(1 << 16), false),
        ] {
            std::fs::write(&path, &text).unwrap();
            assert_eq!(ShowKey::read(&path).is_ok(), is_key, "{text:.80}");
        }
        std::fs::write(&path, [0xff; 64]).unwrap();
        let told = ShowKey::read(&path).unwrap_err().to_string();
        assert!(told.contains("show.key: not a show's key") && !told.contains('\n'), "{told}");
    }
}
