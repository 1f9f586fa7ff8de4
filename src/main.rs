//! The program: deepfield with the modes and formats that it comes with.

fn main() -> std::process::ExitCode {
    deepfield::Program::default().run()
}
