//! A mode as the user has set it, applied to data: weights and attributes of particles and of codebook entries.

use super::{Adapter, Columns, Conserved, Footprint, LevelChoice, Levels, Mode, Needs, Settings, lod_budget};
use crate::codec::Codebook;
use crate::color::transfer::{Range, Scale, TransferFunction};
use crate::hierarchy::Purpose;
use crate::store::{FamilyMetadata, Metadata, Node};
use crate::view::{Detail, Scope, View};

/// A mode, its settings and the attribute that colours the picture.
#[derive(Clone)]
pub struct Depiction {
    /// The mode.
    pub mode: &'static Mode,
    /// Its settings.
    pub settings: Settings,
    /// The attribute averaged into `S`; none for a picture without colour channel.
    pub attribute: Option<Coloring>,
    /// Which levels of a hierarchy it is drawn from.
    pub choice: LevelChoice,
}

/// The attribute averaged into `S`.
#[derive(Clone, Debug, PartialEq)]
pub struct Coloring {
    /// Its name.
    pub name: String,
    /// What particles without a value count as (families that lack the attribute): its mean where it is known.
    pub fallback: f32,
    /// Its smallest value; 0 where that is not known.
    pub least: f64,
}

/// What the codes of one codebook stand for in a depiction; all columns have the codebook's length.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeTable {
    /// Smoothing length `h` (support radius), world units.
    pub smoothing_length: Vec<f32>,
    /// Weight `w`.
    pub weight: Vec<f32>,
    /// Attribute `a`, if the picture has colour.
    pub attribute: Option<Vec<f32>>,
    /// The particles' own densities, if the mode draws with them.
    pub density: Option<Vec<f32>>,
    /// The columns whose fields are drawn ([`super::Technique::fields`]); NaN for what has no value.
    pub fields: Vec<Vec<f32>>,
    /// How much a particle's absence would show; see [`lod_budget::importance`].
    pub importance: Vec<f32>,
    /// The largest of them.
    pub most_important: f32,
}

/// Weights and attributes of particles.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceColumns {
    /// Weight `w` of each particle.
    pub weight: Vec<f32>,
    /// Attribute `a` of each particle, if the picture has colour.
    pub attribute: Option<Vec<f32>>,
    /// The particles' own densities, if the mode draws with them.
    pub density: Option<Vec<f32>>,
    /// The columns whose fields are drawn ([`super::Technique::fields`]); NaN for what has no value.
    pub fields: Vec<Vec<f32>>,
}

impl Depiction {
    /// `mode` for some data; `attribute` as the user named it, else the mode's usual one if the data has it.
    ///
    /// # Errors
    /// The names that the data has, when it has none called `attribute`; and for a mode that draws no particles.
    pub fn new(
        mode: &'static Mode,
        settings: Settings,
        attribute: Option<&str>,
        metadata: &Metadata,
    ) -> Result<Depiction, String> {
        if !mode.takes_particles() {
            let draws = if mode.takes_surfaces() { "heights" } else { "images and volumes" };
            return Err(format!("mode {} draws {draws}, found particles", mode.name));
        }
        let columns = metadata.families.iter().flat_map(|family| {
            let columns = family.quantities.iter().chain(&family.attributes);
            columns.map(|info| (info, family.count as f64))
        });
        let mut names: Vec<&str> = columns.clone().map(|(info, _)| info.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let absent = |what: &str, name: &str| {
            let expected = names.join(", ");
            let others = "(build --attributes keeps others that its source has)";
            Err(format!("{what} {name} is not in the data, expected one of {expected} {others}"))
        };
        for field in mode.technique.fields(&settings) {
            if !names.contains(&field.as_str()) {
                return absent("field", &field);
            }
        }
        let attribute = match mode.attribute(attribute, &names) {
            Some(name) if !names.contains(&name) => return absent("attribute", name),
            Some(name) => {
                let own = columns.filter(|(info, _)| info.name == name);
                let (sum, count) =
                    own.clone().fold((0.0, 0.0), |(sum, n), (info, count)| (sum + info.mean * count, n + count));
                let fallback = if count > 0.0 { (sum / count) as f32 } else { 0.0 };
                let least = own.map(|(info, _)| info.min).fold(f64::INFINITY, f64::min);
                Some(Coloring { name: name.to_owned(), fallback, least: if least.is_finite() { least } else { 0.0 } })
            }
            None => None,
        };
        Ok(Depiction { mode, settings, attribute, choice: LevelChoice::default() })
    }

    /// A transfer function that nobody has chosen, as it suits the attribute: a range of numbers is meant for the mode's own
    /// attribute, and a logarithm is no scale for values below zero.
    pub fn suited(&self, mut transfer: TransferFunction) -> TransferFunction {
        let Some(coloring) = &self.attribute else { return transfer };
        let foreign = self.mode.usual_attributes.first() != Some(&coloring.name.as_str());
        if foreign && transfer.hue.as_ref().is_some_and(|hue| hue.range != Range::Auto) {
            transfer.hue = TransferFunction::preset("density-hue").and_then(|preset| preset.hue);
        }
        if let Some(hue) = &mut transfer.hue
            && hue.range == Range::Auto
            && coloring.least < 0.0
        {
            hue.scale = Scale::Linear;
        }
        transfer
    }

    /// What draws it on an adapter.
    pub fn adapter(&self) -> Adapter {
        self.mode.technique.adapter()
    }

    /// Whether it is of fields of columns ([`super::Technique::fields`]).
    pub fn draws_fields(&self) -> bool {
        !self.mode.technique.fields(&self.settings).is_empty()
    }

    /// What the mode's technique needs with these settings.
    pub fn needs(&self) -> Needs {
        self.mode.technique.needs(&self.settings)
    }

    /// How far a particle reaches in the picture.
    pub fn footprint(&self) -> Footprint {
        self.needs().footprint
    }

    /// How far splats reach beyond what they are in space, pixels: a disc's radius, and by how much all are blurred.
    pub fn reach_px(&self) -> f64 {
        let Needs { footprint, blur_px, .. } = self.needs();
        match footprint {
            Footprint::Kernel => blur_px,
            Footprint::Pixels(radius) => f64::from(radius).hypot(blur_px),
        }
    }

    /// The view by which nodes are selected: what lies just outside the picture reaches into it.
    /// (How far smoothing lengths reach, nodes know themselves.)
    pub fn selection_view(&self, view: &View) -> View {
        match self.reach_px() {
            reach if reach > 0.0 => view.padded(reach.ceil() as u32),
            _ => *view,
        }
    }

    /// The levels that are drawn of a file.
    pub fn purpose(&self, metadata: &Metadata) -> Purpose {
        let wanted = self.needs().purpose;
        match wanted {
            _ if self.draws_clusters(metadata) => Purpose::Clusters,
            _ if metadata.has_volume_levels() => wanted,
            _ => Purpose::Splats,
        }
    }

    /// Whether clusters are drawn of a file.
    fn draws_clusters(&self, metadata: &Metadata) -> bool {
        let is_wanted = match self.choice.levels {
            Levels::Auto => self.choice.is_bounded(),
            Levels::Splats => false,
            Levels::Clusters => true,
        };
        is_wanted && self.takes_clusters() && metadata.has_clusters()
    }

    /// Whether the mode can be drawn from clusters.
    pub fn takes_clusters(&self) -> bool {
        self.mode.technique.takes_clusters()
    }

    /// Of the displacement that a picture of a file may have, the share that it has at most: what its mode tolerates where an attribute gives
    /// the hue, and the file has what the mode weighs with.
    pub fn error_share(&self, metadata: &Metadata) -> f64 {
        let attributes = metadata.families.iter().flat_map(|family| &family.attributes);
        let has = |name: &&str| attributes.clone().any(|info| info.name == *name);
        let weighs = self.mode.weight_attributes.iter().all(has);
        if self.attribute.is_some() && weighs { self.mode.hue_tolerance } else { 1.0 }
    }

    /// How far the nodes of a file are refined for a view, where splats may be displaced by `tau` pixels: by [`Depiction::error_share`] of that.
    pub fn detail(&self, view: &View, tau: f64, metadata: &Metadata) -> Detail {
        self.detail_in_motion(view, self.error_share(metadata) * tau, metadata)
    }

    /// The same of a view that moves: its hue waits until it rests. A sample of finer particles would be less of the picture in the same time,
    /// and pages that serve hue alone would come before those of the way ahead.
    pub fn detail_in_motion(&self, view: &View, tau: f64, metadata: &Metadata) -> Detail {
        match (self.choice.splats, self.purpose(metadata)) {
            (Some(splats), _) if self.takes_clusters() => Detail::Budget { splats, scope: Scope::Picture },
            (_, Purpose::Samples) => self.mode.technique.detail(view, &self.settings, metadata.bounds(), tau),
            (_, Purpose::Splats | Purpose::Clusters) => Detail::Error { tau },
        }
    }

    /// What the codes of a codebook of `family` stand for.
    pub fn table(&self, family: &FamilyMetadata, codebook: &Codebook) -> CodeTable {
        let SourceColumns { weight, attribute, density, fields } = self.columns_of(family, codebook);
        let pairs = codebook.mass.iter().zip(&codebook.smoothing_length);
        let importance: Vec<f32> = pairs.map(|(&m, &h)| lod_budget::importance(m, h)).collect();
        let most_important = importance.iter().copied().fold(0.0, f32::max);
        let smoothing_length = codebook.smoothing_length.clone();
        CodeTable { smoothing_length, weight, attribute, density, fields, importance, most_important }
    }

    /// The factor on the decoded weights of `node` that makes them add up to what the node stands for.
    pub fn node_scale(&self, node: &Node) -> f32 {
        match self.mode.conserves {
            Conserved::Mass => node.mass_scale,
            Conserved::MassDensity => node.mass_density_scale,
            Conserved::Neither => 1.0,
        }
    }

    /// Weights and attributes of values of `family`.
    pub fn columns_of(&self, family: &FamilyMetadata, values: &Codebook) -> SourceColumns {
        self.columns_named(family.attributes.iter().map(|info| info.name.as_str()), values)
    }

    /// The same of values whose attributes have these names.
    pub fn columns_named<'a>(&self, names: impl Iterator<Item = &'a str>, values: &'a Codebook) -> SourceColumns {
        let attributes: Vec<(&str, &[f32])> = names.zip(values.attributes.iter().map(Vec::as_slice)).collect();
        self.values_of(&Columns {
            mass: &values.mass,
            density: &values.density,
            smoothing_length: &values.smoothing_length,
            attributes: &attributes,
        })
    }

    /// Weights and attributes of particles.
    pub fn values_of(&self, columns: &Columns<'_>) -> SourceColumns {
        let fields = self.mode.technique.fields(&self.settings);
        let weight = if fields.is_empty() { (self.mode.weight)(columns) } else { volumes(columns) };
        let field = |name: &String| columns.named(name).map_or_else(|| vec![f32::NAN; weight.len()], <[f32]>::to_vec);
        let fields = fields.iter().map(field).collect();
        let attribute = self.attribute.as_ref().map(|coloring| match columns.named(&coloring.name) {
            Some(values) => values.iter().map(|&a| if a.is_finite() { a } else { coloring.fallback }).collect(),
            None => vec![coloring.fallback; weight.len()],
        });
        let density = self.needs().densities.then(|| columns.density.to_vec());
        SourceColumns { weight, attribute, density, fields }
    }
}

/// The space that particles stand for, `m / rho`; none for those of no density.
fn volumes(columns: &Columns<'_>) -> Vec<f32> {
    let of_one = |(mass, density): (&f32, &f32)| if *density > 0.0 { mass / density } else { 0.0 };
    columns.mass.iter().zip(columns.density).map(of_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modes;

    #[test]
    fn colours_suit_the_attribute() {
        let depiction = |mode: &str, name: &str, least: f64| Depiction {
            mode: modes::find(mode).unwrap(),
            settings: Settings::default(),
            attribute: Some(Coloring { name: name.into(), fallback: 1.0, least }),
            choice: LevelChoice::default(),
        };
        let stars = TransferFunction::preset("stars").unwrap();
        assert_eq!(depiction("points", "color-index", -0.4).suited(stars.clone()), stars);
        let hue = depiction("points", "internal-energy", 0.1).suited(stars.clone()).hue.unwrap();
        assert_eq!((hue.range, hue.scale), (Range::Auto, Scale::Log));
        assert_eq!(depiction("points", "velocity-x", -3.0).suited(stars).hue.unwrap().scale, Scale::Linear);
        let usual = TransferFunction::of_volumes(true);
        assert_eq!(depiction("volume", "temperature", 10.0).suited(usual.clone()), usual);
        // A few zeros are no reason: the range begins above them.
        assert_eq!(depiction("volume", "metallicity", 0.0).suited(usual.clone()), usual);
    }
}
