//! How files end, by which dialogs choose among them.

use super::data;
use deepfield::import::grid::grid_extensions;
use deepfield::import::{extensions, open};

#[test]
fn what_is_opened_ends_as_its_formats_say() {
    let known = [extensions(), grid_extensions()].concat();
    let mut opened = 0;
    for folder in ["", "blosc", "others"] {
        for entry in std::fs::read_dir(data(folder)).unwrap() {
            let path = entry.unwrap().path();
            // Names without an end are those of formats that have none.
            let Some(end) = path.extension().and_then(|end| end.to_str()) else { continue };
            if path.is_file() && open(&path).is_ok() {
                assert!(known.contains(&end), "{}", path.display());
                opened += 1;
            }
        }
    }
    assert!(opened > 40, "{opened} files");
    for end in &known {
        assert!(!end.is_empty() && end.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit()), "{end}");
    }
    // Each once, so that a dialog's list is no longer than it has to be.
    let own = extensions();
    assert!(own.iter().enumerate().all(|(index, end)| !own[..index].contains(end)), "{own:?}");
}
