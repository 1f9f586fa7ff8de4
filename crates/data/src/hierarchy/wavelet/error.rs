//! By what a node's set is chosen, and what its error is.

/// By what the set of a node is chosen (WM03 section 4.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Types {
    /// By its measured error among all sets.
    #[default]
    Measured,
    /// One large point or samples: the hierarchy of Laur and Hanrahan.
    Round,
    /// By its coefficients of directed filters, as published: a direction counts where its own is large, and none but its neighbours' are.
    Gabor,
}

/// What counts as a node's error (WM03 section 4.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// iii: the difference of the samples and what is drawn.
    #[default]
    Residual,
    /// ii: the variation of the samples, whatever is drawn.
    Rms,
    /// i: the largest coefficient of directed filters of what is not drawn: of the nodes below and, but for a directed set, of the node.
    Gabor,
}

impl Options {
    /// Whether coefficients of directed filters are needed.
    pub(super) fn needs_coefficients(&self) -> bool {
        self.types == Types::Gabor || self.metric == Metric::Gabor
    }
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
    /// Samples below this in all channels count as air: they are left out as those that are no numbers are. In stored values.
    pub ignore_below: Option<f32>,
}

/// Errors of a grid against its samples, over all samples that are numbers and all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// The largest difference.
    pub max: f32,
    /// The root of the mean of its square.
    pub rms: f32,
}
