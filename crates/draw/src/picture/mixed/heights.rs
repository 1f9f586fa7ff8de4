//! The measured heights of a scene of several kinds of data, as the rest is drawn among them.

use crate::cpu::paths::PathFragments;
use crate::cpu::surface::darken::depths;
use crate::cpu::surface::fragments::{Layer, fragments};
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::{SurfaceOptions, SurfaceReport, draw};
use crate::look::{LookPatch, Member};
use crate::picture::ground::Ground;
use crate::picture::placement::FieldPlacement;
use crate::picture::surface::session::Prepared;
use crate::picture::surface::{SurfaceChannels, SurfaceSession};
use crate::view::View;
use std::sync::{Mutex, PoisonError};

/// A field that is drawn.
struct Standing<'a> {
    nodes: &'a PagedSurface,
    placed: Placed,
    placement: FieldPlacement,
    options: SurfaceOptions,
}

/// The fields of heights of a picture.
pub(super) struct HeightsAmong<'a> {
    fields: Vec<Standing<'a>>,
    report: Mutex<SurfaceReport>,
}

impl<'a> HeightsAmong<'a> {
    /// As each of them is prepared and placed, in their order.
    pub fn new(
        fields: &'a mut [(Member, SurfaceSession)],
        prepared: &[Prepared],
        placements: Vec<FieldPlacement>,
        look: &LookPatch,
    ) -> HeightsAmong<'a> {
        let each = fields.iter_mut().zip(prepared).zip(placements).map(|(((_, session), prepared), placement)| {
            let options = SurfaceOptions { raw: false, ..session.surface_options(prepared, look) };
            let placed = prepared.placed;
            Standing { nodes: session.nodes(prepared), placed, placement, options }
        });
        let report = Mutex::new(SurfaceReport { is_converged: true, ..SurfaceReport::default() });
        HeightsAmong { fields: each.collect(), report }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// What was drawn.
    pub fn report(&self) -> SurfaceReport {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Why something could not be read.
    pub fn error(&self) -> Option<String> {
        self.fields.iter().find_map(|field| field.nodes.error())
    }

    /// Raw channels at pixels' centres, of what is nearest there.
    pub fn channels(&self, sight: &Sight) -> SurfaceChannels {
        let [width, height] = sight.size();
        let mut whole: Vec<[f64; 7]> = Vec::new();
        for Standing { nodes, placed, placement, options } in &self.fields {
            let (own, options) = (placement.sight(sight), SurfaceOptions { look: None, raw: true, ..options.clone() });
            nodes.prepare(placed, &own, &options);
            let mut drawn = draw(*nodes, placed, &own, &options).raw;
            drawn.iter_mut().for_each(|channels| channels[0] *= placement.scale);
            match whole.is_empty() {
                true => whole = drawn,
                false => whole.iter_mut().zip(drawn).for_each(|(whole, own)| {
                    if own[0] < whole[0] || whole[0].is_nan() {
                        *whole = own;
                    }
                }),
            }
        }
        SurfaceChannels { width, height, values: whole }
    }

    /// Darkens parts of a view where fields hide light from themselves and each other: what is told of one holds for all.
    fn darken(&self, view: &View, parts: &mut PathFragments) {
        let own = self.fields.iter().filter_map(|field| Some(field.options.shadowing?.scaled(field.placement.scale)));
        if let Some(shadowing) = own.max_by(|a, b| a.scene.total_cmp(&b.scene)) {
            shadowing.darken_fragments(view, parts, &mut |from: &View| Some(self.depths(from)));
        }
    }

    /// Depths at a view's pixels' centres, row by row, of what is nearest there.
    fn depths(&self, view: &View) -> Vec<f32> {
        let mut whole: Vec<f32> = Vec::new();
        for Standing { nodes, placed, placement, options } in &self.fields {
            let options = SurfaceOptions { look: None, raw: false, ..options.clone() };
            let sight = Sight::Flat(placement.view(view));
            let mut own = depths((*nodes, placed, &sight), &options);
            own.iter_mut().for_each(|depth| *depth = (f64::from(*depth) * placement.scale) as f32);
            match whole.is_empty() {
                true => whole = own,
                false => whole.iter_mut().zip(own).for_each(|(whole, own)| *whole = whole.min(own)),
            }
        }
        whole
    }
}

impl Ground for HeightsAmong<'_> {
    fn fragments(&self, view: &View) -> PathFragments {
        let sights: Vec<Sight> = self.fields.iter().map(|field| Sight::Flat(field.placement.view(view))).collect();
        for (field, sight) in self.fields.iter().zip(&sights) {
            field.nodes.prepare(&field.placed, sight, &field.options);
        }
        let layers = self.fields.iter().zip(&sights).map(|(Standing { nodes, placed, placement, options }, sight)| {
            Layer { source: *nodes, placed, sight, options, scale: placement.scale }
        });
        let (mut found, report) = fragments(&layers.collect::<Vec<_>>());
        self.darken(view, &mut found);
        self.report.lock().unwrap_or_else(PoisonError::into_inner).add(&report);
        found
    }
}
