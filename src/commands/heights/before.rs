//! Earlier heights that heights are compared with, as the user names them.

use crate::look::HeightsSaid;
use std::path::PathBuf;

/// Earlier heights.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Height fields")]
pub struct BeforeOptions {
    /// An earlier state of the heights: colours show the attribute difference, later minus earlier, over the later surface. What is said of heights
    /// is said of both; samples may be elsewhere.
    #[arg(long, value_name = "FILE")]
    pub before: Option<PathBuf>,
}

impl BeforeOptions {
    /// What is said of heights, with the earlier ones.
    pub fn with(&self, said: HeightsSaid) -> HeightsSaid {
        HeightsSaid { before: self.before.clone(), ..said }
    }

    /// Refuses earlier heights where there are none to compare with them.
    ///
    /// # Errors
    /// Where they are named.
    pub fn refuse(&self) -> Result<(), String> {
        match &self.before {
            None => Ok(()),
            Some(before) => {
                Err(format!("{}: --before: found no heights to compare it with, expected some", before.display()))
            }
        }
    }
}
