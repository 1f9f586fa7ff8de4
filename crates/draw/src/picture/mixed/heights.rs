//! The measured heights of a scene of several kinds of data, as the rest is drawn among them.

use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Lighting, Shadowing};
use crate::cpu::surface::darken::depths;
use crate::cpu::surface::fragments::{Layer, fragments_found};
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::raster::Visibility;
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::stitch::Scene;
use crate::cpu::surface::{SurfaceOptions, SurfaceReport, draw};
use crate::look::{Backend, LookPatch, Member};
use crate::picture::placement::FieldPlacement;
use crate::picture::session::Reporter;
use crate::picture::surface::painting::{Field, Painter};
use crate::picture::surface::session::Prepared;
use crate::picture::surface::{SurfaceChannels, SurfaceSession};
use crate::view::View;
use std::sync::{Arc, Mutex, PoisonError};

/// A field that is drawn.
struct Standing<'a> {
    nodes: &'a PagedSurface,
    /// The least and the largest height.
    extremes: [f64; 2],
    placed: Placed,
    placement: FieldPlacement,
    options: SurfaceOptions,
}

/// What finds what is seen of a field beside the processor, for somebody who asks for a backend.
pub(super) struct Finder<'a> {
    pub painter: Mutex<&'a mut Painter>,
    pub backend: Option<Backend>,
    pub reporter: &'a dyn Reporter,
}

/// The fields of heights of a picture.
pub(super) struct HeightsAmong<'a> {
    fields: Vec<Standing<'a>>,
    finder: Finder<'a>,
    report: Mutex<SurfaceReport>,
}

impl<'a> HeightsAmong<'a> {
    /// As each of them is prepared and placed, in their order.
    pub fn new(
        fields: &'a mut [(Member, SurfaceSession)],
        prepared: &[Prepared],
        placements: Vec<FieldPlacement>,
        look: &LookPatch,
        finder: Finder<'a>,
    ) -> HeightsAmong<'a> {
        let each = fields.iter_mut().zip(prepared).zip(placements).map(|(((_, session), prepared), placement)| {
            let options = SurfaceOptions { raw: false, ..session.surface_options(prepared, look) };
            let (placed, extremes) = (prepared.placed, session.extremes());
            Standing { nodes: session.nodes(prepared), extremes, placed, placement, options }
        });
        let report = Mutex::new(SurfaceReport { is_converged: true, ..SurfaceReport::default() });
        HeightsAmong { fields: each.collect(), finder, report }
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
        for Standing { nodes, placed, placement, options, .. } in &self.fields {
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

    /// What each sample of a view, whose pixels are these samples, shows of a field's scene, where an adapter finds it.
    fn seen(&self, scene: &Arc<Scene>, sight: &Sight) -> Option<Visibility> {
        // Each of several fields would take the room of the others' samples, picture for picture.
        let [Standing { nodes, extremes, placed, options, .. }] = &self.fields[..] else { return None };
        let Finder { painter, backend, reporter } = &self.finder;
        let field = Field { nodes, placed, extremes: *extremes };
        let mut painter = painter.lock().unwrap_or_else(PoisonError::into_inner);
        painter.seen(&field, (scene, sight), options, *backend, *reporter)
    }

    /// How fields hide light from themselves and each other: what is told of one holds for all.
    pub fn shadowing(&self) -> Option<Shadowing> {
        let own = self.fields.iter().filter_map(|field| Some(field.options.shadowing?.scaled(field.placement.scale)));
        own.max_by(|a, b| a.scene.total_cmp(&b.scene))
    }

    /// Depths at a view's pixels' centres, row by row, of what is nearest there; `None` where there are no fields.
    pub fn opaque(&self, view: &View) -> Option<Vec<f32>> {
        (!self.fields.is_empty()).then(|| self.depths(view))
    }

    fn depths(&self, view: &View) -> Vec<f32> {
        let mut whole: Vec<f32> = Vec::new();
        for Standing { nodes, placed, placement, options, .. } in &self.fields {
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

    /// What each pixel of a view shows of them, from front to back.
    pub fn fragments(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        let sights: Vec<Sight> = self.fields.iter().map(|field| Sight::Flat(field.placement.view(view))).collect();
        for (field, sight) in self.fields.iter().zip(&sights) {
            field.nodes.prepare(&field.placed, sight, &field.options);
        }
        let layers = self.fields.iter().zip(&sights).map(|(field, sight)| {
            let Standing { nodes, placed, placement, options, .. } = field;
            Layer { source: *nodes, placed, sight, options, scale: placement.scale }
        });
        let find = |scene: &Arc<Scene>, sight: &Sight| self.seen(scene, sight);
        let (mut found, report) = fragments_found(&layers.collect::<Vec<_>>(), &find);
        if let Some(shadowing) = self.shadowing() {
            let own = |from: &View| Some(self.depths(from));
            shadowing.darken_fragments(view, &mut found, &own, lighting.others.as_ref());
        }
        self.report.lock().unwrap_or_else(PoisonError::into_inner).add(&report);
        found
    }
}
