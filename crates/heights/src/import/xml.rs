//! Descriptions in XML.

use super::content::{Content, in_one_line};
use deepfield_data::import::ImportError;
use roxmltree::{Document, Node};

/// The tree of a text; `name` is what messages call it.
///
/// # Errors
/// Where it is no XML.
pub(super) fn parsed<'t>(content: &Content, name: &str, text: &'t str) -> Result<Document<'t>, ImportError> {
    let wrong = |error: roxmltree::Error| content.malformed(name, in_one_line(&error), "well-formed XML");
    Document::parse(text.trim_start_matches('\u{feff}')).map_err(wrong)
}

/// The elements of a description.
pub(super) struct Elements<'d, 'c> {
    /// The file that it is in.
    pub content: &'c Content,
    /// Its name.
    pub name: &'c str,
    /// Its tree.
    pub document: &'d Document<'d>,
}

impl<'d> Elements<'d, '_> {
    /// The element at a path of names, wherever the first of them is.
    pub(super) fn find(&self, path: &[&str]) -> Option<Node<'d, 'd>> {
        let (first, rest) = path.split_first()?;
        let is = |node: &Node, name: &str| node.is_element() && node.tag_name().name() == name;
        let start = self.document.descendants().find(|node| is(node, first))?;
        rest.iter().try_fold(start, |node, name| node.children().find(|child| is(child, name)))
    }

    /// Its text; `None` where there is none or nothing in it.
    pub(super) fn text(&self, path: &[&str]) -> Option<&'d str> {
        self.find(path)?.text().map(str::trim).filter(|text| !text.is_empty())
    }

    /// The message that there is no such element, or nothing in it.
    pub(super) fn missing(&self, path: &[&str]) -> ImportError {
        self.content.missing(&path.join("/"), &format!("an element of {}", self.name))
    }

    /// The text of an element that has to be there.
    ///
    /// # Errors
    /// Where it is not.
    pub(super) fn needed(&self, path: &[&str]) -> Result<&'d str, ImportError> {
        self.text(path).ok_or_else(|| self.missing(path))
    }

    /// A number, where there is one.
    ///
    /// # Errors
    /// Where something else stands there.
    pub(super) fn number<T: std::str::FromStr>(&self, path: &[&str], expected: &str) -> Result<Option<T>, ImportError> {
        let wrong = |text: &str| self.content.malformed(&path.join("/"), text, expected);
        self.text(path).map(|text| text.parse().map_err(|_| wrong(text))).transpose()
    }
}
