//! What is told about pages that cannot be read: the first ones one by one, and not a flood of them; of a server each cause once, as many pages have
//! it in common.

use crate::model::is_url;
use crate::store::{Change, PageId};
use std::path::Path;
use std::time::Duration;

/// Pages of a file that are told one by one.
const TOLD: usize = 3;

/// What has been told about a file, and what is to be told.
#[derive(Debug, Default)]
pub(crate) struct Report {
    failed: usize,
    failed_roots: usize,
    /// Why a server does not give pages, as far as it has been told.
    causes: Vec<String>,
    change: Option<Change>,
    is_stalled: bool,
    messages: Vec<String>,
}

impl Report {
    /// What is to be told since the last call, one sentence each.
    pub fn take(&mut self) -> Vec<String> {
        std::mem::take(&mut self.messages)
    }

    /// A page was given up; `why` names file and page.
    pub fn failed(&mut self, path: &Path, why: &str) {
        let is_afar = is_url(path);
        let cause = cause_of(why);
        if is_afar && self.causes.iter().any(|told| told == cause) {
            return;
        }
        self.failed += 1;
        if self.failed <= TOLD {
            let others = if is_afar { ", and wherever else that is so" } else { "" };
            self.messages.push(format!("{why}; the picture is coarser there{others}"));
            self.causes.push(cause.to_owned());
        } else if self.failed == TOLD + 1 {
            let path = path.display();
            self.messages.push(format!("{path}: more pages cannot be read; the picture is coarser there"));
        }
    }

    /// The page of a root was given up, which nothing coarser stands for: what is to be told of that, where enough has not been told.
    pub fn failed_root(&mut self, path: &Path, why: &str) -> Option<String> {
        self.failed_roots += 1;
        match self.failed_roots {
            ..=TOLD => Some(format!("{why}; what it stands for is not drawn")),
            first if first == TOLD + 1 => {
                Some(format!("{}: more pages cannot be read; what they stand for is not drawn", path.display()))
            }
            _ => None,
        }
    }

    /// A page could be read, but something has become of the file.
    pub fn changed(&mut self, path: &Path, change: Change) {
        if self.change.replace(change) != Some(change) && self.failed == 0 {
            self.messages
                .push(format!("{}: {change}; what was open is shown as far as it can be read", path.display()));
        }
    }

    /// A read has been without an answer for so long.
    pub fn stalled(&mut self, path: &Path, page: PageId, age: Duration) {
        if !std::mem::replace(&mut self.is_stalled, true) {
            let (who, path, page, seconds) = (answering(path), path.display(), page.0, age.as_secs_f64());
            self.messages.push(format!(
                "{path}: page {page}: {who} has not answered for {seconds:.1} s; the picture is coarser there until it does"
            ));
        }
    }

    /// No read is without an answer any more.
    pub fn answered(&mut self, path: &Path) {
        if std::mem::replace(&mut self.is_stalled, false) {
            self.messages.push(format!("{}: {} answers again", path.display(), answering(path)));
        }
    }
}

/// Why a page cannot be read, of a message that names file and page before.
fn cause_of(why: &str) -> &str {
    let behind = why.split_once(": page ").and_then(|(_, page)| page.split_once(": "));
    behind.map_or(why, |(_, cause)| cause)
}

/// Who answers reads of a file.
fn answering(path: &Path) -> &'static str {
    if is_url(path) { "the server" } else { "the disk" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_pages_are_told_and_then_that_there_are_more() {
        let (mut report, path) = (Report::default(), Path::new("a.df"));
        (0..100).for_each(|page| report.failed(path, &format!("a.df: page {page}: its checksum")));
        let told = report.take();
        assert_eq!(told.len(), TOLD + 1);
        assert!(told[0].contains("page 0") && told[TOLD].contains("more pages"));
        let told: Vec<_> =
            (0..100).filter_map(|page| report.failed_root(path, &format!("a.df: page {page}: gone"))).collect();
        assert!(told.len() == TOLD + 1 && told[0].contains("page 0") && told[TOLD].contains("more pages"), "{told:?}");
        let (mut of_server, url) = (Report::default(), Path::new("https://data.example/a.df"));
        for page in 0..100 {
            let cause = ["asks for a token", "has a fault of its own"][page % 2];
            of_server.failed(url, &format!("{}: page {page}: cannot be read: data.example {cause}", url.display()));
        }
        let told = of_server.take();
        assert!(told.len() == 2 && told[0].contains("page 0: ") && told[1].contains("page 1: "), "{told:?}");
        // Causes without end are not told without end.
        (0..100).for_each(|page| of_server.failed(url, &format!("a.df: page {page}: found {page}")));
        assert_eq!(of_server.take().len(), TOLD + 1 - 2);
        (0..9).for_each(|page| report.stalled(path, PageId(page), Duration::from_secs(5)));
        report.answered(path);
        report.answered(path);
        let told = report.take();
        assert!(told.len() == 2 && told[0].contains("page 0: the disk has not answered for 5.0 s"), "{told:?}");
    }
}
