//! deepfield with one more mode and one more format.

fn main() -> std::process::ExitCode {
    brightest::program().run()
}
