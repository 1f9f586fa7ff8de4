//! What is set in the environment of the program before it loads the first graphics driver.

#![allow(unsafe_code, reason = "setting a variable is unsafe while other threads may read variables")]

use std::ffi::OsString;

/// Switches off Mesa's device selection layer where all that it would do is to complain: it asks for a Wayland compositor
/// whenever a Vulkan instance may draw to one, and libwayland prints `error: XDG_RUNTIME_DIR is invalid or not set` where that
/// variable is missing, for each instance.
///
/// To be called first of all in `main`: does nothing once there is a second thread.
pub fn prepare() {
    if is_layer_useless(|name| std::env::var_os(name)) && is_single_threaded() {
        // SAFETY: this is the only thread (`is_single_threaded`), so none reads or writes the environment meanwhile.
        unsafe { std::env::set_var(SWITCH, "1") };
    }
}

/// What switches the layer off, by its manifest.
const SWITCH: &str = "NODEVICE_SELECT";

/// Whether there is no compositor that the layer could ask, and the user has not chosen a device with it.
fn is_layer_useless(variable: impl Fn(&str) -> Option<OsString>) -> bool {
    let is_set = |name: &str| variable(name).is_some_and(|value| !value.is_empty());
    // libwayland takes an absolute path, or a name in an absolute folder.
    let is_absolute = |name: &str| variable(name).is_some_and(|value| value.as_encoded_bytes().starts_with(b"/"));
    let chooses = ["MESA_VK_DEVICE_SELECT", "DRI_PRIME", SWITCH].into_iter().any(is_set);
    cfg!(target_os = "linux") && !is_absolute("XDG_RUNTIME_DIR") && !is_absolute("WAYLAND_DISPLAY") && !chooses
}

/// Whether the process is known to have one thread.
fn is_single_threaded() -> bool {
    std::fs::read_dir("/proc/self/task").is_ok_and(|threads| threads.count() == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_layer_goes_where_there_is_no_compositor_and_no_choice() {
        let useless = |variables: &[(&str, &str)]| {
            is_layer_useless(|name| variables.iter().find(|(own, _)| *own == name).map(|(_, value)| value.into()))
        };
        assert_eq!(useless(&[]), cfg!(target_os = "linux"));
        assert_eq!(useless(&[("XDG_RUNTIME_DIR", "here"), ("DISPLAY", ":7")]), cfg!(target_os = "linux"));
        for (name, value) in [
            ("XDG_RUNTIME_DIR", "/run/user/1000"),
            ("WAYLAND_DISPLAY", "/run/wayland-0"),
            ("MESA_VK_DEVICE_SELECT", "list"),
            ("DRI_PRIME", "1"),
        ] {
            assert!(!useless(&[(name, value)]), "{name}");
        }
    }

    #[test]
    fn a_second_thread_keeps_the_environment_as_it_is() {
        let before = std::env::var_os(SWITCH);
        std::thread::spawn(|| {
            assert!(!is_single_threaded());
            prepare();
        })
        .join()
        .unwrap();
        assert_eq!(std::env::var_os(SWITCH), before);
    }
}
