//! What a run's directory says about tracks: what they have in common, and what was found over each interval.

use super::flow::{FlowParts, MOST_FLOW_LEVELS};
use super::layout::Section;
use crate::codec::AttributeMerge;
use crate::hierarchy::RootCell;
use crate::hierarchy::spacetime::{Interpolation, Lattice};
use crate::model::{ClockVariable, Cosmology, Epoch, FamilyName, Motion, Unit};
use crate::store::error::Damage;
use crate::store::wire::{Decoder, Encoder};
use serde::{Deserialize, Serialize};

/// What messages call it.
const PLACE: &str = "directory, tracks";
/// What velocities may mean, by their numbers in the directory.
const MOTIONS: [Motion; 4] = [Motion::Unknown, Motion::Coordinate, Motion::Peculiar, Motion::Gadget];
/// Where tangents may come from, by their numbers.
const TANGENTS: [Tangents; 3] = [Tangents::Velocity, Tangents::Differences, Tangents::None];

/// Where the tangents of tracks come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tangents {
    /// The velocities that are stored.
    #[default]
    Velocity,
    /// Positions at neighbouring steps.
    Differences,
    /// Nowhere: tracks are straight.
    None,
}

impl Tangents {
    /// Its word on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Tangents::Velocity => "velocity",
            Tangents::Differences => "differences",
            Tangents::None => "none",
        }
    }
}

impl std::str::FromStr for Tangents {
    type Err = String;

    fn from_str(text: &str) -> Result<Tangents, String> {
        let found = TANGENTS.into_iter().find(|known| known.name() == text);
        found.ok_or_else(|| "expected velocity, differences or none".into())
    }
}

/// A family that has tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackFamily {
    /// Which.
    pub name: FamilyName,
    /// Where its tangents come from.
    pub tangents: Tangents,
    /// Whether its particles have ids of their own; else they are counted in the order of the sources.
    pub has_ids: bool,
    /// What stored velocities were multiplied with beside what the clock asks for, because displacements say so.
    pub velocity_scale: f64,
    /// Unit of stored velocities.
    pub velocity_unit: Unit,
    /// Name and unit of each attribute.
    pub attributes: Vec<(String, Unit)>,
}

impl TrackFamily {
    /// How each attribute is averaged.
    pub fn rules(&self) -> Vec<AttributeMerge> {
        self.attributes.iter().map(|(name, _)| AttributeMerge::of(name)).collect()
    }

    /// How its particles move where somebody wants `interpolation`: tracks without tangents are straight.
    pub fn moved(&self, interpolation: Interpolation) -> Interpolation {
        match (self.tangents, interpolation) {
            (Tangents::None, Interpolation::Auto | Interpolation::Hermite) => Interpolation::Linear,
            (_, interpolation) => interpolation,
        }
    }
}

/// What the tracks of a run have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackLayout {
    /// The grid of positions.
    pub lattice: Lattice,
    /// Edge of the box that tracks go round, whose corner is the origin.
    pub box_size: Option<f64>,
    /// Whether positions are comoving.
    pub is_comoving: bool,
    /// The universe around comoving snapshots.
    pub cosmology: Option<Cosmology>,
    /// What stored velocities mean.
    pub motion: Motion,
    /// The clock's value at each step.
    pub clock: Vec<f64>,
    /// The families.
    pub families: Vec<TrackFamily>,
    /// The error of each flow level, from level 1, the finest, on, run units.
    pub flow_errors: Vec<f64>,
}

impl TrackLayout {
    /// The longer one of the intervals that adjoin a step.
    pub fn span(&self, step: usize) -> f64 {
        span(&self.clock, step)
    }

    /// The length of the interval after a step.
    pub fn length(&self, interval: usize) -> f64 {
        match self.clock.get(interval..interval + 2) {
            Some(pair) => pair[1] - pair[0],
            None => 1.0,
        }
    }

    /// What stored velocities are multiplied with to give `dx/dtau`, at a header's time and scale factor.
    pub fn velocity_factor(&self, variable: ClockVariable, time: f64, scale_factor: Option<f64>) -> f64 {
        let epoch = Epoch { time: Some(time), scale_factor, cosmology: self.cosmology, motion: self.motion };
        variable.velocity_factor(&epoch).unwrap_or(1.0)
    }

    /// The clock's value at a scale factor.
    pub(super) fn clock_at(&self, variable: ClockVariable, scale_factor: f64) -> Option<f64> {
        let scale_factor = Some(scale_factor);
        variable.value(&Epoch { time: scale_factor, scale_factor, cosmology: self.cosmology, motion: self.motion })
    }

    pub(super) fn encode(&self, out: &mut Encoder) {
        out.vec3(self.lattice.root.min);
        out.f64(self.lattice.root.size);
        out.option_f64(self.box_size);
        out.u8(u8::from(self.is_comoving));
        out.u8(u8::from(self.cosmology.is_some()));
        if let Some(Cosmology { omega_matter, omega_lambda, hubble, hubble_assumed }) = self.cosmology {
            [omega_matter, omega_lambda, hubble].into_iter().for_each(|value| out.f64(value));
            out.u8(u8::from(hubble_assumed));
        }
        out.u8(MOTIONS.iter().position(|motion| *motion == self.motion).unwrap_or(0) as u8);
        self.clock.iter().for_each(|value| out.f64(*value));
        out.u32(self.families.len() as u32);
        for family in &self.families {
            out.text(family.name.as_str());
            out.u8(TANGENTS.iter().position(|tangents| *tangents == family.tangents).unwrap_or(0) as u8);
            out.u8(u8::from(family.has_ids));
            out.f64(family.velocity_scale);
            out.text(&family.velocity_unit.0);
            out.u32(family.attributes.len() as u32);
            for (name, unit) in &family.attributes {
                out.text(name);
                out.text(&unit.0);
            }
        }
        out.u32(self.flow_errors.len() as u32);
        self.flow_errors.iter().for_each(|error| out.f64(*error));
    }

    pub(super) fn decode(input: &mut Decoder, steps: usize) -> Result<TrackLayout, Damage> {
        let root = RootCell { min: input.vec3("the root cell")?, size: input.f64("the root cell")? };
        let box_size = input.option_f64("the box that tracks go round")?;
        let is_comoving = flag(input, "whether positions are comoving")?;
        let cosmology = flag(input, "a cosmology")?.then(|| {
            Ok(Cosmology {
                omega_matter: input.f64("omega_matter")?,
                omega_lambda: input.f64("omega_lambda")?,
                hubble: input.f64("hubble")?,
                hubble_assumed: flag(input, "whether hubble is assumed")?,
            })
        });
        let cosmology = cosmology.transpose()?;
        let motion = one_of(input, &MOTIONS, "what velocities mean")?;
        let clock = (0..steps).map(|_| input.f64("the clock's value")).collect::<Result<Vec<_>, _>>()?;
        let count = input.count(4 + 1 + 1 + 8 + 4 + 4, "families")?;
        let families = (0..count).map(|_| decode_family(input)).collect::<Result<Vec<_>, _>>()?;
        let levels = input.count(8, "flow levels")?;
        let flow_errors = (0..levels).map(|_| input.f64("a flow level's error")).collect::<Result<Vec<_>, _>>()?;
        let wrong = |expected: &str| Damage::new(PLACE, expected);
        let is_coarser = |pair: &[f64]| pair[0] < pair[1];
        let is_error = |error: &f64| error.is_finite() && *error > 0.0;
        if levels > MOST_FLOW_LEVELS || !flow_errors.iter().all(is_error) || !flow_errors.windows(2).all(is_coarser) {
            return Err(wrong("flow levels with errors that rise"));
        }
        if !(root.min.is_finite() && root.size.is_finite() && root.size > 0.0) {
            return Err(wrong("a root cell that has an edge"));
        }
        if box_size.is_some_and(|edge| !(edge > 0.0 && edge.is_finite())) {
            return Err(wrong("a box that has an edge"));
        }
        if !clock.iter().all(|value| value.is_finite()) || clock.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(wrong("a clock that goes forward"));
        }
        let lattice = Lattice { root };
        Ok(TrackLayout { lattice, box_size, is_comoving, cosmology, motion, clock, families, flow_errors })
    }
}

/// The longer one of the intervals of a clock that adjoin a step.
pub fn span(clock: &[f64], step: usize) -> f64 {
    let length = |first: usize| clock.get(first..first + 2).map_or(0.0, |pair| pair[1] - pair[0]);
    let longer = length(step).max(step.checked_sub(1).map_or(0.0, length));
    if longer > 0.0 { longer } else { 1.0 }
}

fn decode_family(input: &mut Decoder) -> Result<TrackFamily, Damage> {
    let name = input.text("a family's name")?;
    let name = FamilyName::parse(&name).ok_or_else(|| Damage::new(PLACE, format!("a family, found {name:?}")))?;
    let tangents = one_of(input, &TANGENTS, "where tangents come from")?;
    let has_ids = flag(input, "ids")?;
    let velocity_scale = input.f64("the scale of velocities")?;
    if !(velocity_scale > 0.0 && velocity_scale.is_finite()) {
        return Err(Damage::new(PLACE, "a positive scale of velocities"));
    }
    let velocity_unit = Unit(input.text("the unit of velocities")?);
    let count = input.count(8, "attributes")?;
    let attribute = |_| Ok((input.text("an attribute's name")?, Unit(input.text("an attribute's unit")?)));
    let attributes = (0..count).map(attribute).collect::<Result<_, Damage>>()?;
    Ok(TrackFamily { name, tangents, has_ids, velocity_scale, velocity_unit, attributes })
}

fn flag(input: &mut Decoder, what: &str) -> Result<bool, Damage> {
    one_of(input, &[false, true], what)
}

fn one_of<T: Copy>(input: &mut Decoder, all: &[T], what: &str) -> Result<T, Damage> {
    let number = input.u8(what)?;
    let known = all.get(usize::from(number)).copied();
    known.ok_or_else(|| Damage::new(PLACE, format!("{what} as a number below {}, found {number}", all.len())))
}

/// How far off something is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// Root of the mean square.
    pub rms: f64,
    /// What 99 of 100 do not exceed.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

/// What was found of a family over an interval. Counts are of particles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Matches {
    /// In the family at both ends.
    pub matched: u64,
    /// At the end only.
    pub born: u64,
    /// At the beginning only.
    pub vanished: u64,
    /// In another family at the end.
    pub changed: u64,
    /// At the beginning, with an id that is not theirs alone.
    pub ambiguous: u64,
    /// Matched ones whose tracks end beyond a face of the box.
    pub crossing: u64,
    /// Share of the matched mass whose steps are too far apart for a spline.
    pub unresolved: f64,
    /// By how much displacements are longer than velocities say; `None` where nothing moves or no velocities are known.
    pub velocity_factor: Option<f64>,
    /// How far the places at the end are from the spline between the steps around it; `None` where there is no later step.
    pub leave_one_out: Option<Deviation>,
    /// How far stored places are from those of the snapshots: mean and largest distance, of both ends.
    pub position_error: [f64; 2],
}

/// The tracks of a family over an interval.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FamilyTracks {
    /// What was found.
    pub matches: Matches,
    /// Number of tracks of source particles.
    pub tracks: u64,
    /// Number of nodes.
    pub count: u32,
    /// The nodes.
    pub nodes: Section,
    /// The index of the nodes.
    pub index: Section,
    /// Its CRC-32C.
    pub index_crc: u32,
    /// Its flow levels.
    pub flow: FlowParts,
}

/// The tracks over an interval.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IntervalTracks {
    /// Those of each family, in the order of [`TrackLayout::families`].
    pub families: Vec<FamilyTracks>,
}

impl IntervalTracks {
    /// Its sections as they follow one another: the flow levels of all families, then nodes and index of each.
    pub fn sections(&self) -> impl Iterator<Item = Section> + use<'_> {
        let flow =
            self.families.iter().filter(|family| !family.flow.levels.is_empty()).map(|family| family.flow.section);
        flow.chain(self.families.iter().flat_map(|family| [family.nodes, family.index]))
    }

    pub(super) fn encode(&self, out: &mut Encoder) {
        for FamilyTracks { matches, tracks, count, nodes, index, index_crc, flow } in &self.families {
            let Matches { matched, born, vanished, changed, ambiguous, crossing, .. } = *matches;
            [matched, born, vanished, changed, ambiguous, crossing].into_iter().for_each(|count| out.u64(count));
            out.f64(matches.unresolved);
            out.option_f64(matches.velocity_factor);
            let deviation = matches.leave_one_out;
            out.u8(u8::from(deviation.is_some()));
            let Deviation { rms, p99, max } = deviation.unwrap_or_default();
            [rms, p99, max].into_iter().chain(matches.position_error).for_each(|value| out.f64(value));
            out.u64(*tracks);
            out.u32(*count);
            out.section(*nodes);
            out.section(*index);
            out.u32(*index_crc);
            flow.encode(out);
        }
    }

    /// Those over an interval.
    pub(super) fn decode(
        input: &mut Decoder,
        interval: usize,
        families: usize,
        levels: usize,
    ) -> Result<IntervalTracks, Damage> {
        let families = (0..families).map(|_| {
            let mut count = || input.u64("matches");
            let (matched, born, vanished) = (count()?, count()?, count()?);
            let (changed, ambiguous, crossing) = (count()?, count()?, count()?);
            let unresolved = input.f64("the share that is unresolved")?;
            let velocity_factor = input.option_f64("the velocity factor")?;
            let is_measured = flag(input, "a step left out")?;
            let mut value = || input.f64("a deviation");
            let deviation = Deviation { rms: value()?, p99: value()?, max: value()? };
            let position_error = [value()?, value()?];
            let leave_one_out = is_measured.then_some(deviation);
            let matches = Matches {
                matched,
                born,
                vanished,
                changed,
                ambiguous,
                crossing,
                unresolved,
                velocity_factor,
                leave_one_out,
                position_error,
            };
            Ok(FamilyTracks {
                matches,
                tracks: input.u64("the number of tracks")?,
                count: input.u32("the number of nodes")?,
                nodes: Section::decode(input)?,
                index: Section::decode(input)?,
                index_crc: input.u32("the checksum of an index")?,
                flow: FlowParts::decode(input, interval, levels)?,
            })
        });
        Ok(IntervalTracks { families: families.collect::<Result<_, Damage>>()? })
    }
}
