//! What every target does with its bytes.

use deepfield::import::{FORMATS, LoadOptions, load_source, summarize_source};
use std::io::Write;

/// Opens `bytes` as the format whose name begins with `format`, whatever they look like, and reads all of it. Errors are
/// fine; panics, endless loops and runaway memory are what the fuzzer looks for.
pub fn import(format: &str, bytes: &[u8]) {
    let Ok(mut file) = tempfile::NamedTempFile::new() else { return };
    if file.write_all(bytes).is_err() {
        return;
    }
    let formats = FORMATS.iter().filter(|candidate| candidate.name().starts_with(format));
    for source in formats.filter_map(|candidate| candidate.open(file.path()).ok()) {
        let summary = summarize_source(source.as_ref());
        let loaded = load_source(source.as_ref(), &LoadOptions::default(), &());
        if let (Ok(summary), Ok(loaded)) = (summary, loaded) {
            let skipped: u64 = loaded.skipped.iter().map(|skipped| skipped.count).sum();
            assert_eq!(loaded.len() as u64 + skipped, summary.particles);
        }
    }
}
