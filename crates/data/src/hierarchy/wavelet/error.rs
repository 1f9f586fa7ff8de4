//! By what a node's set is chosen, and what its error is.

/// By what the set of a node is chosen (WM03 section 4.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Types {
    /// By its measured error among all sets.
    #[default]
    Measured,
    /// One large point or samples: the hierarchy of Laur and Hanrahan.
    Round,
}

/// What counts as a node's error (WM03 section 4.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// iii: the difference of the samples and what is drawn.
    #[default]
    Residual,
    /// ii: the variation of the samples, whatever is drawn.
    Rms,
}

/// How images and volumes are taken apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// By what sets are chosen.
    pub types: Types,
    /// What counts as an error.
    pub metric: Metric,
    /// Whether three or four channels are red, green and blue: then differences of lightness count most.
    pub colours: bool,
}

/// Errors of a grid against its samples, over all samples that are numbers and all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// The largest difference.
    pub max: f32,
    /// The root of the mean of its square.
    pub rms: f32,
}
