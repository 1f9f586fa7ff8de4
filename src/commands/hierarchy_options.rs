//! Options of `build` about the hierarchy: what its nodes merge, leave out and hold, and how they share pages.

use super::arguments::bytes;
use crate::build::BuildOptions;
use crate::hierarchy::pca::SplitRule;
use crate::hierarchy::{ClusterOptions, Kind, Kinds, Matter, OctreeOptions};

/// How the hierarchy is built.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Hierarchy")]
pub struct HierarchyOptions {
    /// What is built over the leaves.
    #[arg(long, value_name = "KINDS", help = format!("What is built over the leaves, of particles one or more of: {} [default: octree]; of images and volumes: {}", Kind::list(Matter::Particles), Kind::list(Matter::Grids)))]
    pub hierarchy: Option<Kinds>,
    /// Particles of a cluster of the finest level, and clusters of one level in one of the next, on average, 2 to 64.
    #[arg(long, value_name = "N", default_value_t = ClusterOptions::default().size, value_parser = cluster_size)]
    pub cluster_size: f64,
    /// Which cluster is split next: relative (where the members' spread is large against their kernels) or distortion (HE03).
    #[arg(long, value_name = "RULE", default_value = "relative", value_parser = split_rule)]
    pub split: SplitRule,
    /// Bits of the code of a cluster's shape: 0 (all round), 8, 12 or 16.
    #[arg(long, value_name = "BITS", default_value_t = ClusterOptions::default().shape_bits, value_parser = shape_bits)]
    pub shape_bits: u8,
    /// Bytes that a page aims at, 64KiB to 64MiB. Smaller pages bring less that a view does not need, larger ones take fewer
    /// requests, each of which waits for the disk.
    #[arg(long, value_name = "BYTES", default_value = "3MiB", value_parser = page_bytes)]
    pub page_size: usize,
    /// Particles of a leaf at most, 16 to 1048576. Smaller leaves follow the view more closely, larger ones take fewer nodes and
    /// less space.
    #[arg(long, value_name = "N", default_value_t = OctreeOptions::default().leaf_capacity, value_parser = leaf_particles)]
    pub leaf_particles: usize,
    /// Largest difference of smoothing lengths that particles of a cell are merged across, in cells, 0 to 8 (epsilon of F12 4.7.3).
    /// More merges more, which is drawn faster and is less like the particles themselves.
    #[arg(long, value_name = "CELLS", default_value_t = OctreeOptions::default().fusion, value_parser = fusion)]
    pub fusion: f64,
    /// Share of its mass and of its sum of m rho that a merged node may leave out, its faintest particles, 0 to 0.5; the rest makes up
    /// for them. More draws fewer particles and loses faint ones far away.
    #[arg(long, value_name = "SHARE", default_value_t = OctreeOptions::default().thinning_budget, value_parser = budget)]
    pub thinning_budget: f64,
    /// Share of what its children draw above which a node holds no particles of its own and its children are drawn instead, 0.1 to
    /// 1. Less takes less space, and draws up to 1/share times the particles that a view needs.
    #[arg(long, value_name = "SHARE", default_value_t = OctreeOptions::default().relay_fraction, value_parser = relay_share)]
    pub relay_share: f64,
    /// Particles up to which a family's root cell is as large as their box, 1 or more; for each factor of 8 beyond, it is twice as
    /// large, up to 16 times. Fewer bring the first picture sooner, more take fewer levels.
    #[arg(long, value_name = "N", default_value_t = OctreeOptions::default().root_particles, value_parser = root_particles)]
    pub root_particles: u64,
}

impl HierarchyOptions {
    /// The hierarchies over something that are asked for, if any are.
    pub fn of(&self, matter: Matter) -> Option<Kinds> {
        self.hierarchy.filter(|kinds| kinds.matter() == Some(matter))
    }

    /// Sets what of a build they say.
    pub fn apply(&self, options: &mut BuildOptions) {
        options.hierarchies = self.of(Matter::Particles).unwrap_or_default();
        options.clusters = ClusterOptions { size: self.cluster_size, rule: self.split, shape_bits: self.shape_bits };
        options.page_bytes = self.page_size;
        options.octree.leaf_capacity = self.leaf_particles;
        options.octree.fusion = self.fusion;
        options.octree.thinning_budget = self.thinning_budget;
        options.octree.relay_fraction = self.relay_share;
        options.octree.root_particles = self.root_particles;
    }
}

fn cluster_size(text: &str) -> Result<f64, String> {
    number(text, 2.0, 64.0)
}

fn split_rule(text: &str) -> Result<SplitRule, String> {
    match text {
        "relative" => Ok(SplitRule::Relative),
        "distortion" => Ok(SplitRule::Distortion),
        _ => Err("expected relative or distortion".into()),
    }
}

fn shape_bits(text: &str) -> Result<u8, String> {
    let bits = text.parse().ok().filter(|bits| [0, 8, 12, 16].contains(bits));
    bits.ok_or_else(|| "expected 0, 8, 12 or 16".into())
}

fn page_bytes(text: &str) -> Result<usize, String> {
    let value = bytes(text)?;
    let range = 64 << 10..=64 << 20;
    if range.contains(&value) { Ok(value as usize) } else { Err("expected 64KiB to 64MiB".into()) }
}

fn leaf_particles(text: &str) -> Result<usize, String> {
    let value = text.parse().ok().filter(|value| (16..=1 << 20).contains(value));
    value.ok_or_else(|| "expected a whole number from 16 to 1048576".into())
}

fn fusion(text: &str) -> Result<f64, String> {
    number(text, 0.0, 8.0)
}

/// Of more than half, nothing might be left.
fn budget(text: &str) -> Result<f64, String> {
    number(text, 0.0, 0.5)
}

fn relay_share(text: &str) -> Result<f64, String> {
    number(text, 0.1, 1.0)
}

fn root_particles(text: &str) -> Result<u64, String> {
    let value = text.parse().ok().filter(|value| *value > 0);
    value.ok_or_else(|| "expected a whole number of at least 1".into())
}

fn number(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("expected a number from {least} to {most}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        hierarchy: HierarchyOptions,
    }

    fn parsed(arguments: &[&str]) -> Result<BuildOptions, clap::Error> {
        let line = Line::try_parse_from([&["build"], arguments].concat())?;
        let mut options = BuildOptions::default();
        line.hierarchy.apply(&mut options);
        Ok(options)
    }

    #[test]
    fn without_options_a_build_is_the_usual_one() {
        assert_eq!(parsed(&[]).unwrap(), BuildOptions::default());
    }

    #[test]
    fn every_option_sets_its_own_field_and_refuses_what_is_out_of_range() {
        let set: [(&str, &str, fn(&mut BuildOptions), &[&str]); 6] = [
            ("--page-size", "256KiB", |options| options.page_bytes = 256 << 10, &["1KiB", "65MiB", "large"]),
            ("--leaf-particles", "100", |options| options.octree.leaf_capacity = 100, &["0", "15", "1048577", "1.5"]),
            ("--fusion", "1.5", |options| options.octree.fusion = 1.5, &["-1", "8.1", "nan"]),
            ("--thinning-budget", "0", |options| options.octree.thinning_budget = 0.0, &["-0.1", "0.51", "inf"]),
            ("--relay-share", "0.9", |options| options.octree.relay_fraction = 0.9, &["0", "0.09", "1.01"]),
            ("--root-particles", "1000", |options| options.octree.root_particles = 1000, &["0", "-1", "1e6"]),
        ];
        for (name, value, change, wrong) in set {
            let mut expected = BuildOptions::default();
            change(&mut expected);
            assert_eq!(parsed(&[name, value]).unwrap(), expected);
            for wrong in wrong {
                let error = parsed(&[&format!("{name}={wrong}")]).unwrap_err();
                assert_eq!(error.exit_code(), 2);
                assert!(error.to_string().contains(name) && error.to_string().contains("expected"), "{error}");
            }
        }
    }
}
