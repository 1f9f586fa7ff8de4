//! How many cases property tests try, shared by all of them.

use proptest::test_runner::Config;

/// Cases of proptest's own default, to which `PROPTEST_CASES` is compared.
const DEFAULT: u64 = 256;

/// A test of `usual` cases, and in proportion more or fewer where `PROPTEST_CASES` is not 256.
pub fn cases(usual: u32) -> Config {
    let config = Config::default();
    let cases = (u64::from(usual) * u64::from(config.cases)).div_ceil(DEFAULT);
    Config { cases: u32::try_from(cases).unwrap_or(u32::MAX), ..config }
}
