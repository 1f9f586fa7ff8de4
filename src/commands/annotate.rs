//! What `deepfield render` writes into its pictures.

use crate::annotate::Annotations;
use std::path::PathBuf;

/// What is written into a picture.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct AnnotateOptions {
    /// Write into the picture: legend, scale-bar, clock, axes, triad, labels, with commas [default: nothing; without PARTS:
    /// legend,scale-bar].
    #[arg(long, value_name = "PARTS", num_args = 0..=1, require_equals = true,
          default_missing_value = "legend,scale-bar", value_parser = parts)]
    pub annotate: Option<Annotations>,
    /// A line at the top of the picture.
    #[arg(long, value_name = "TEXT")]
    pub caption: Option<String>,
    /// Write the names of a catalogue's objects: CSV, RON, or a group catalogue in HDF5 (see `deepfield catalogue --help`); names of a CSV
    /// without z stand on the surface of heights.
    #[arg(long, value_name = "CATALOGUE")]
    pub labels: Option<PathBuf>,
    /// Size of text and lines in the picture: 1 has letters of 13 pixels [default: by the picture's size].
    #[arg(long, value_name = "FACTOR", value_parser = scale)]
    pub text_scale: Option<f32>,
}

/// Parts by name, with commas.
fn parts(text: &str) -> Result<Annotations, String> {
    text.split(',').map(str::trim).try_fold(Annotations::NONE, Annotations::with)
}

fn scale(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|scale| Annotations::SCALES.contains(scale));
    value.ok_or_else(|| "expected a number from 0.25 to 16".into())
}

impl AnnotateOptions {
    /// Whether any is on the command line.
    pub fn is_given(&self) -> bool {
        self.annotate.is_some() || self.caption.is_some() || self.labels.is_some()
    }

    /// What is written, where `config` says so too: nothing for `None`.
    pub fn over(&self, config: Option<Annotations>) -> Option<Annotations> {
        if !self.is_given() && config.is_none() {
            return None;
        }
        let config = config.unwrap_or(Annotations::NONE);
        let named = self.annotate.clone().map(|named| Annotations {
            caption: config.caption.clone(),
            scale: config.scale,
            ..named
        });
        let mut all = named.unwrap_or(config);
        all.caption = self.caption.clone().unwrap_or(all.caption);
        all.scale = self.text_scale.or(all.scale);
        if self.labels.is_some() && all.labels == 0 {
            all.labels = Annotations::default().labels;
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_override_the_file() {
        let none = AnnotateOptions::default();
        assert_eq!(none.over(None), None);
        assert_eq!(none.over(Some(Annotations::default())), Some(Annotations::default()));
        let file = Annotations { caption: "from the file".into(), scale: Some(2.0), ..Annotations::default() };
        let named = AnnotateOptions { annotate: Some(parts("axes, legend").unwrap()), ..none.clone() };
        let both = named.over(Some(file.clone())).unwrap();
        assert!(both.axes && both.legend && !both.scale_bar && both.caption == "from the file");
        let caption = AnnotateOptions { caption: Some("mine".into()), text_scale: Some(3.0), ..none };
        let both = caption.over(Some(file)).unwrap();
        assert!(both.scale_bar && both.caption == "mine" && both.scale == Some(3.0));
        let named = AnnotateOptions { labels: Some("clusters.csv".into()), ..AnnotateOptions::default() };
        assert!(named.over(None).unwrap().labels > 0 && !named.over(None).unwrap().legend);
        assert!(parts("legend,axis").is_err() && scale("0").is_err());
    }
}
