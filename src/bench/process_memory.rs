//! How much memory a process takes, where the system tells it.

/// The most that a process (`self`, or its number) has taken so far, bytes.
pub fn peak_memory(process: &str) -> Option<u64> {
    said(process, "VmHWM:")
}

/// What this one takes now, bytes.
#[cfg(feature = "remote")]
pub fn resident_memory() -> Option<u64> {
    said("self", "VmRSS:")
}

fn said(process: &str, field: &str) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(field))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes << 10)
}
