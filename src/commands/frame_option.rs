//! The frame of tables on the command line.

/// In which frame comoving numbers are written.
#[derive(clap::ValueEnum, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrameName {
    /// As the data has them.
    #[default]
    Comoving,
    /// Lengths by the scale factor, densities by its third power, peculiar velocities.
    Physical,
}

/// Why a table cannot be written in the physical frame.
pub fn unknown(path: &std::path::Path) -> String {
    format!(
        "{}: --frame: found data that does not say its scale factor and what its velocities are, expected a comoving source or run that \
         does, or --frame comoving",
        path.display()
    )
}
