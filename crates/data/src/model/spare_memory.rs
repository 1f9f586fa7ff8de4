//! Memory that the program has freed and the allocator keeps.

/// Gives it back to the system, where that is known to keep much. The C library of most Linux systems has an arena for each of some threads, and
/// what one of them has freed of many large pieces serves no other: the arenas of threads that read pages would each keep as much as it held at its
/// fullest. Costs about a millisecond for each hundred megabytes that are given back, and as much again for whoever needs them next.
pub fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: the function takes a number alone, may be called at any time by any thread, and moves nothing that is in use.
    unsafe {
        libc::malloc_trim(0);
    }
}
