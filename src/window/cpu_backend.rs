//! Drawing with the processor, on background tasks, and the measurement of how bright the view is; idle while an adapter draws.
//!
//! While the view moves, as large a sample of the particles is drawn as the preset's time for a picture allows, with fewer
//! pixels where that is not all of them; volumes have a fixed limit, and as many pixels as there is time for. When the
//! view rests, the full picture follows. What is given up for that is the preset's [`MotionPreset`]. Where surfaces darken each other, an adapter
//! beside the window's may draw what the processor then darkens.

mod beside;
mod drawing;

use super::exposure::Exposure;
use super::live::LiveParticles;
use super::look::{Held, Look};
use super::occlusion::Occlusion;
use super::pages::{SplatsInTime, ViewSelection};
use super::paths::Paths;
use super::picture::{Letterbox, Picture, to_image};
use super::picture_sizes::{LightSamples, drawing_size, moving_ms, moving_size, volume_limit};
use super::preset::{MotionPreset, Preset};
use super::scene::{Scene, Settings};
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Converged, Statistics};
use super::touring::Before;
use crate::color::composite::composite_glowing;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Image as Colors};
use crate::cpu::volume::OpaqueDepths;
use crate::hierarchy::Purpose;
use crate::mode::{Footprint, LodBudget, Plan, Raw};
use crate::picture::Subject;
use crate::picture::drawing_cost::DrawingCost;
use crate::picture::fade::faded;
use crate::picture::splat_budget::SplatBudget;
use crate::picture::stand_in::FADE_SECS;
use crate::store::Tree;
use crate::view::View;
use beside::Beside;
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use drawing::{Limits, Outcome, Source, draw};
use std::sync::Arc;
use std::time::Instant;

/// What an accumulation depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DrawKey {
    selection: u64,
    /// The state of live particles.
    live: u64,
    depiction: u64,
    generation: u32,
    size: UVec2,
    /// How many particles a volume may take.
    particles: u64,
    /// The paths among what is shown; 0 without.
    paths: u64,
    /// How its light spreads.
    bloom: [u64; 3],
    /// From how many samples its light is found, where surfaces darken each other.
    light_samples: Option<u32>,
}

/// A picture that has been drawn.
#[derive(Clone)]
struct Drawn {
    key: DrawKey,
    picture: Arc<Accumulation>,
    /// For modes that draw colours: these, and the settings they were drawn with.
    painted: Option<Arc<PaintedPicture>>,
    milliseconds: f64,
    by_adapter: bool,
}

/// A picture in colours, and what they mean.
struct PaintedPicture {
    image: Colors,
    levels: Levels,
    transfer: TransferFunction,
    /// How many particles it took, where those are not all.
    sampled: Option<u64>,
    opaque: Option<Arc<OpaqueDepths>>,
}

/// What a background task hands back.
struct Done {
    drawn: Drawn,
    /// What the settings leave out, whatever time there was.
    plan: Plan,
    /// How many particles it took, if it was drawn anew; and whether that is not all that the plan would.
    taken: Option<u64>,
    cut: bool,
    /// Whether they are clusters that stand in for what the view shows at rest, and the states of view and live particles.
    stands_in: bool,
    revisions: [u64; 2],
    /// Whether everything was there that the view needs.
    complete: bool,
    /// What is to be said.
    told: Option<String>,
    exposure: Exposure,
    /// The picture in colours, and what they were made with.
    colors: (Colors, Levels, TransferFunction),
}

/// The processor's picture and the task that draws the next one.
#[derive(Resource, Default)]
pub struct CpuPicture {
    task: Option<Task<Result<Done, String>>>,
    drawn: Option<Drawn>,
    plan: Plan,
    colored: Option<(DrawKey, Levels, TransferFunction)>,
    drawing_cost: DrawingCost,
    splat_budget: SplatBudget,
    beside: Beside,
    moved: Option<([u64; 2], Instant)>,
    /// What the task draws, and what could not be drawn.
    tried: Option<(DrawKey, TransferFunction)>,
    failed: Option<(DrawKey, TransferFunction)>,
    /// The last finished picture and its number.
    finished: Option<(u64, Arc<Colors>)>,
    /// Of which states of view and live particles it shows clusters that stand in; `None` where it shows the view's own.
    stood_in: Option<[u64; 2]>,
    /// The clusters that the last finished picture took the place of, and when.
    clusters: Option<(Arc<Colors>, Instant)>,
    /// What the window shows: that number, and what is blended with it.
    shown: Option<(u64, Option<(u64, u32)>)>,
    count: u64,
}

impl CpuPicture {
    /// Whether the view or its nodes have changed a moment ago.
    pub fn is_moving(&self, motion: &MotionPreset) -> bool {
        self.moved.is_some_and(|(_, since)| since.elapsed().as_millis() < u128::from(motion.rest_ms))
    }
}

/// Takes in what has been drawn, and starts to draw what is wanted now.
pub(super) fn draw_on_cpu(
    mut cpu: ResMut<CpuPicture>,
    backend: Res<ActiveBackend>,
    scene: Option<Res<Scene>>,
    selection: Res<ViewSelection>,
    look: Option<Res<Look>>,
    (picture, preset): (Res<Picture>, Res<Preset>),
    mut exposure: ResMut<Exposure>,
    mut statistics: ResMut<Statistics>,
    mut converged: ResMut<Converged>,
    mut occlusion: ResMut<Occlusion>,
    mut messages: ResMut<Notices>,
    (live, settings, held, paths): (Res<LiveParticles>, Res<Settings>, Res<Held>, Res<Paths>),
    mut in_time: ResMut<SplatsInTime>,
) {
    let cpu = &mut *cpu;
    let on_cpu = *backend == ActiveBackend::Cpu;
    if *backend != ActiveBackend::Gpu {
        let frame_ms = Some(preset.drawing.frame_ms).filter(|frame_ms| on_cpu && *frame_ms > 0.0);
        in_time.follow(frame_ms.map(|frame_ms| cpu.splat_budget.limit(frame_ms)));
    }
    if on_cpu && statistics.backend != "cpu" {
        "cpu".clone_into(&mut statistics.backend);
    }
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else {
        cpu.task = None;
        return;
    };
    let revisions = [selection.motion, live.state()];
    if cpu.moved.is_none_or(|(before, _)| before != revisions) {
        cpu.moved = Some((revisions, Instant::now()));
    }
    if !on_cpu {
        // Nothing of it is shown, and pages are not decoded for nothing.
        *cpu = CpuPicture { moved: cpu.moved, ..default() };
        return;
    }
    if let Some(outcome) = cpu.task.as_mut().and_then(check_ready) {
        cpu.task = None;
        match outcome {
            Ok(mut done) => {
                if let Some(told) = done.told.take() {
                    messages.error(told);
                }
                let state = done.drawn.key.live;
                let painted = done.drawn.painted.as_ref();
                let opaque = painted.and_then(|painted| painted.opaque.clone());
                // Live particles hide nothing of the file.
                let opaque = opaque.filter(|_| live.particles().is_none());
                let opaque = opaque.filter(|_| look.depiction.needs().hides);
                // A sample's wider kernels may hide what all particles together do not: it says nothing.
                if painted.is_none_or(|painted| painted.sampled.is_none()) {
                    occlusion.drew(opaque, (done.drawn.key.generation, done.drawn.key.depiction), done.complete);
                }
                take_in(cpu, done, &mut exposure, &mut statistics);
                statistics.live = live.particles().map(|_| state);
            }
            Err(error) => {
                cpu.failed = cpu.tried.take();
                messages.error(error);
            }
        }
    }
    if statistics.live.is_some() && live.particles().is_none() {
        statistics.live = None;
    }
    let motion = &preset.motion;
    let moving = cpu.is_moving(motion);
    let fixed_discs = matches!(look.depiction.footprint(), Footprint::Pixels(_));
    let full = picture.size();
    let stands_in = selection.stands_in && live.particles().is_none();
    let limit = match preset.drawing.frame_ms {
        // Clusters were chosen within a limit of their own.
        frame_ms if frame_ms > 0.0 && moving && !stands_in => cpu.drawing_cost.limit(frame_ms, motion.sample_sizes()),
        _ => u64::MAX,
    };
    let painted = look.depiction.mode.is_light();
    let light = LightSamples::of(&look.depiction.settings).filter(|_| painted);
    let size = match painted && moving {
        true => {
            let budget = moving_ms(&preset);
            let last = cpu.drawn.as_ref().filter(|drawn| drawn.painted.is_some() && !drawn.by_adapter);
            let in_motion = |drawn: &Drawn| match light.zip(drawn.key.light_samples) {
                Some((light, samples)) => light.in_motion(drawn.milliseconds, samples),
                None => drawn.milliseconds,
            };
            moving_size(full, last.map(|drawn| (drawn.key.size, in_motion(drawn))), budget, motion)
        }
        false => drawing_size(full, statistics.particles > limit, fixed_discs, motion),
    };
    let among = paths.among();
    let key = DrawKey {
        selection: selection.revision,
        live: live.state(),
        depiction: look.depiction_revision,
        generation: scene.generation,
        size,
        particles: volume_limit(painted && moving, false, statistics.particles, motion),
        paths: among.as_ref().map_or(0, |(revision, _)| *revision),
        bloom: settings.bloom.bits(),
        light_samples: None,
    };
    let last = cpu.drawn.as_ref().map(|drawn| drawn.key);
    let last = last.filter(|last| DrawKey { light_samples: None, ..*last } == key).and_then(|last| last.light_samples);
    let key = DrawKey { light_samples: light.map(|light| light.next(!moving, last)), ..key };
    // Ranges that are given are not looked for in each picture.
    let given = held.0.filter(|levels| painted && levels.p[0] > 0.0 && levels.p[0] < levels.p[1]);
    let transfer = given.map_or_else(|| look.transfer.clone(), |levels| look.transfer.clone().with_levels(&levels));
    let trial = (key, transfer.clone());
    let drawn = cpu.drawn.as_ref().filter(|drawn| drawn.key == key);
    let colored = cpu
        .colored
        .as_ref()
        .is_some_and(|(drawn, levels, with)| *drawn == key && *levels == look.levels && *with == transfer);
    let current = drawn.is_some() && colored;
    // What is hidden may have changed with the last picture.
    let chosen = selection.complete && selection.occlusion == occlusion.revision;
    converged.0 = current && chosen && !moving && size == full && look.settled;
    // The ranges of a transfer function that has changed are measured in the picture that is there.
    if cpu.task.is_some() || (current && look.settled && !look.is_changed()) {
        return;
    }
    // Before the first page has arrived, ranges of colours cannot be measured, and that is no error.
    if painted && selection.nodes.is_empty() && !selection.complete && live.particles().is_none() {
        return;
    }
    // What could not be drawn once cannot be drawn again either.
    if cpu.failed.as_ref() == Some(&trial) {
        return;
    }
    cpu.tried = Some(trial);
    let drawn_with = |drawn: &&Drawn| drawn.painted.as_ref().is_none_or(|painted| painted.transfer == transfer);
    let reused = drawn.filter(drawn_with).cloned();
    let diameter = scene.frame.size().length();
    let (shown, mut depiction) = (scene.tree(), look.depiction.clone());
    LightSamples::set(&mut depiction.settings, key.light_samples);
    // While the view moves, the processor has pictures of few pixels sooner.
    let has_particles = live.particles().is_none() && look.depiction.purpose(scene.metadata()) != Purpose::Clusters;
    let is_darkened = look.depiction.mode.technique.is_darkened(&look.depiction.settings);
    let adapter = cpu.beside.follow(preset.drawing.backend, is_darkened);
    let adapter = adapter.filter(|_| !moving && has_particles && among.is_none());
    let source = match live.particles() {
        Some(particles) => {
            let families = scene.metadata().families.iter().zip(&settings.families);
            let shown = families.filter(|(_, shown)| **shown).map(|(family, _)| family.name).collect();
            Source::Live(Arc::clone(particles), shown)
        }
        None => Source::Nodes(Arc::clone(&selection.nodes)),
    };
    let (levels, lod_budget, bloom) = (look.levels, look.lod_budget, settings.bloom);
    let (complete, families) = (selection.complete, settings.families.clone());
    let (known, old_plan) = (look.settled.then_some(look.levels), cpu.plan);
    // Finding a plan takes longer than there is between two pictures of a motion.
    let kept_plan = match stands_in {
        true => Some(Plan { culling: lod_budget.culling, ..Plan::default() }),
        false => moving.then_some(old_plan),
    };
    cpu.task = Some(AsyncComputeTaskPool::get().spawn(async move {
        let mut told = None;
        let (drawn, plan, taken, cut) = match reused {
            Some(drawn) => (drawn, old_plan, None, false),
            None => {
                let start = Instant::now();
                let (own, nodes) = source.nodes(&view)?;
                let metadata = own.as_ref().map_or(shown.metadata(), |tree| tree.metadata());
                let subject = Subject::new(metadata, &depiction, &transfer, diameter);
                // Of live particles there are the shown ones alone.
                let subject = subject.of_shown(if own.is_some() { &[] } else { &families });
                let limits = match (&own, painted) {
                    (Some(_), _) => Limits { lod_budget: LodBudget::NONE, plan: None, particles: u64::MAX },
                    (None, true) => Limits { lod_budget: LodBudget::NONE, plan: None, particles: key.particles },
                    (None, false) => Limits { lod_budget, plan: kept_plan, particles: limit },
                };
                let share = f64::from(size.y) / f64::from(view.height.max(1));
                let sized = View { width: size.x, height: size.y, ..view };
                let among = among.map(|(_, paths)| paths.fragments(&sized, share)).transpose()?;
                let outcome = draw(&subject, &nodes, (&view, size), &limits, (known, among.as_ref()), adapter.as_ref());
                let Outcome { values, plan, taken, is_cut, by_adapter, told: said } =
                    outcome.map_err(|error| error.to_string())?;
                told = said;
                let milliseconds = 1000.0 * start.elapsed().as_secs_f64();
                let sampled = is_cut.then_some(taken);
                let painted = |image, levels, opaque, sampled| {
                    let transfer = transfer.clone();
                    let painted = Arc::new(PaintedPicture { image, levels, transfer, sampled, opaque });
                    (
                        Drawn { key, picture: Arc::default(), painted: Some(painted), milliseconds, by_adapter },
                        old_plan,
                        None,
                        false,
                    )
                };
                match values {
                    Some(Raw::Sums(sums, _)) => {
                        let picture = Arc::new(sums);
                        let drawn = Drawn { key, picture, painted: None, milliseconds, by_adapter };
                        (drawn, plan, Some(taken), is_cut)
                    }
                    Some(Raw::Light(light)) => {
                        let found = Levels { p: light.levels.density, s: light.levels.attribute };
                        painted(bloom.image(&light.colors), found, light.report.opaque, sampled)
                    }
                    // A view without data is a black picture, and no error.
                    None => painted(Colors::black(size.x, size.y), levels, None, None),
                }
            }
        };
        let (exposure, colors) = match &drawn.painted {
            Some(painted) => {
                let subject = Subject::new(shown.metadata(), &depiction, &transfer, diameter).of_shown(&families);
                let exposure = Exposure::of_codebooks(&subject, painted.levels);
                (exposure, (painted.image.clone(), levels, transfer.clone()))
            }
            None => {
                let colors = (composite_glowing(&drawn.picture, &transfer, &levels, &bloom), levels, transfer.clone());
                (Exposure::of(&drawn.picture, &transfer), colors)
            }
        };
        let plan = if stands_in { old_plan } else { plan };
        Ok(Done { drawn, plan, taken, cut, stands_in, revisions, complete, told, exposure, colors })
    }));
}

/// Takes in a finished task's work.
fn take_in(cpu: &mut CpuPicture, done: Done, exposure: &mut ResMut<Exposure>, statistics: &mut ResMut<Statistics>) {
    exposure.set_if_neq(done.exposure);
    let (colors, levels, transfer) = done.colors;
    let stands_in = done.stands_in.then_some(done.revisions);
    if let Some((_, clusters)) = cpu.finished.take()
        && stands_in != cpu.stood_in
    {
        let follows = stands_in.is_none() && cpu.stood_in == Some(done.revisions);
        cpu.clusters = follows.then(|| (clusters, Instant::now()));
    }
    cpu.stood_in = stands_in;
    cpu.count += 1;
    cpu.finished = Some((cpu.count, Arc::new(colors)));
    cpu.colored = Some((done.drawn.key, levels, transfer));
    if let Some(taken) = done.taken {
        statistics.draw_ms = Some(done.drawn.milliseconds);
        statistics.sampled = done.cut.then_some(taken);
        match done.stands_in {
            true => cpu.splat_budget.drew(taken, done.drawn.milliseconds),
            false => cpu.drawing_cost.drew(taken, done.drawn.milliseconds),
        }
    }
    if let Some(painted) = &done.drawn.painted {
        statistics.draw_ms = Some(done.drawn.milliseconds);
        statistics.sampled = painted.sampled;
    }
    cpu.plan = done.plan;
    cpu.drawn = Some(done.drawn);
}

/// Shows the finished picture, where a tour says so blended with the one before it.
pub(super) fn show_on_cpu(
    mut cpu: ResMut<CpuPicture>,
    backend: Res<ActiveBackend>,
    before: Res<Before>,
    picture: Res<Picture>,
    mut images: ResMut<Assets<Image>>,
    mut letterbox: ResMut<Letterbox>,
    mut converged: ResMut<Converged>,
) {
    let cpu = cpu.bypass_change_detection();
    if *backend != ActiveBackend::Cpu {
        // What is drawn meanwhile is not known here.
        (cpu.finished, cpu.shown) = (None, None);
        return;
    }
    converged.0 &= before.is_settled();
    let Some((number, finished)) = &cpu.finished else { return };
    // Without the picture before, what was shown last stays.
    if before.is_awaited() {
        return;
    }
    let fade = before.fade();
    let passed = cpu.clusters.as_ref().map(|(_, since)| since.elapsed().as_secs_f32() / FADE_SECS);
    let from_clusters = passed.filter(|share| *share < 1.0 && fade.is_none());
    converged.0 &= from_clusters.is_none();
    let wanted = match (fade, from_clusters) {
        (Some((_, share)), _) => (*number, Some((before.number(), share.to_bits()))),
        (None, Some(share)) => (*number, Some((number - 1, share.to_bits()))),
        (None, None) => (*number, None),
    };
    if cpu.shown == Some(wanted) {
        return;
    }
    let colors = match (fade, from_clusters, &cpu.clusters) {
        (Some((image, share)), ..) => faded(image, finished, share),
        (None, Some(share), Some((clusters, _))) => faded(clusters, finished, share),
        _ => Colors::clone(finished),
    };
    if from_clusters.is_none() {
        cpu.clusters = None;
    }
    if images.insert(&picture.image, to_image(colors)).is_err() {
        warn!("the picture's image is gone");
    }
    letterbox.set_if_neq(Letterbox(None));
    cpu.shown = Some(wanted);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build};
    use crate::mode::SettingValue;
    use crate::modes::shadowing::{LIGHT_SAMPLES, LIGHT_SIZE, SHADOWS};
    use crate::modes::spheres;
    use crate::store::PageFile;
    use crate::stream::first_nodes;
    use crate::synth::{self, merger::Merger};
    use crate::view::Projection;
    use crate::window::look::{follow_settings, glide_levels};
    use crate::window::preset::Backend;
    use crate::window::touring::player::tests::Window;
    use crate::window::transfer_presets::TransferPresets;
    use bevy::math::DVec3;
    use bevy::tasks::TaskPool;
    use std::time::Duration;

    #[test]
    fn shadows_have_few_samples_in_motion_and_ever_more_at_rest() {
        AsyncComputeTaskPool::get_or_init(TaskPool::new);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("merger.df");
        build(synth::dataset(&Merger::new(1, 3000)), &BuildOptions::default(), &path, &()).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        let (eye, full) = (DVec3::new(70.0, 35.0, 150.0), UVec2::new(96, 60));
        let projection = Projection::Perspective { fov_y: 0.5 };
        let view = View::look_at(eye, DVec3::ZERO, DVec3::Y, projection, full.x, full.y).unwrap();
        let nodes = first_nodes(&*file, &view).unwrap().into();
        let mut window = Window::new();
        let app = &mut window.app;
        app.world_mut().resource_mut::<Picture>().rect = Rect::new(0.0, 0.0, 96.0, 60.0);
        let mut settings = app.world_mut().resource_mut::<Settings>();
        settings.choose_mode(&spheres::MODE);
        for (setting, number) in [(&SHADOWS, 0.7), (&LIGHT_SIZE, 12.0), (&LIGHT_SAMPLES, 20.0)] {
            settings.look.settings.set(setting, SettingValue::Number(number));
        }
        let mut preset = app.world_mut().resource_mut::<Preset>();
        (preset.drawing.backend, preset.motion.rest_ms) = (Backend::Cpu, u64::MAX);
        let budget = moving_ms(&preset);
        app.insert_resource(Scene::of_file(file, Vec::new()))
            .insert_resource(ViewSelection { view: Some(view), nodes, complete: true, ..default() })
            .init_resource::<CpuPicture>()
            .init_resource::<ActiveBackend>()
            .init_resource::<Exposure>()
            .init_resource::<Statistics>()
            .init_resource::<Converged>()
            .init_resource::<Occlusion>()
            .init_resource::<LiveParticles>()
            .init_resource::<Held>()
            .init_resource::<Paths>()
            .init_resource::<SplatsInTime>()
            .init_resource::<TransferPresets>()
            .add_systems(Last, (follow_settings, glide_levels, draw_on_cpu).chain());
        let latest = |app: &App| app.world().resource::<CpuPicture>().drawn.clone();
        window.wait("a picture in motion", |app| latest(app).is_some());
        // Others of more pixels follow.
        for _ in 0..30 {
            assert_eq!(latest(&window.app).unwrap().key.light_samples, Some(4));
            window.frame(0.0);
            std::thread::sleep(Duration::from_millis(1));
        }
        window.app.world_mut().resource_mut::<Preset>().motion.rest_ms = 0;
        let mut found = Vec::new();
        let start = Instant::now();
        while !window.app.world().resource::<Converged>().0 {
            // Ranges glide for some seconds.
            window.frame(0.05);
            std::thread::sleep(Duration::from_millis(1));
            assert!(start.elapsed() < Duration::from_secs(60), "waited in vain for all samples");
            let whole = latest(&window.app).filter(|drawn| drawn.key.size == full);
            found.extend(whole.and_then(|drawn| drawn.key.light_samples.zip(drawn.painted)));
        }
        found.dedup_by_key(|(samples, _)| *samples);
        let samples: Vec<u32> = found.iter().map(|(samples, _)| *samples).collect();
        assert_eq!(samples, [4, 16, 20]);
        assert!(found[0].1.image != found[2].1.image, "each is drawn from its own samples");
        // What moves next is as large as there is time for with few pictures of what the lamp sees.
        let world = window.app.world_mut();
        let took = 0.9 * budget * f64::from(1 + 20) / f64::from(1 + 4);
        world.resource_mut::<CpuPicture>().drawn.as_mut().unwrap().milliseconds = took;
        let mut selection = world.resource_mut::<ViewSelection>();
        (selection.revision, selection.motion) = (1, 1);
        world.resource_mut::<Preset>().motion.rest_ms = u64::MAX;
        window.wait("another view", |app| latest(app).is_some_and(|drawn| drawn.key.selection == 1));
        let key = latest(&window.app).unwrap().key;
        assert_eq!((key.size, key.light_samples), (full, Some(4)));
    }
}
