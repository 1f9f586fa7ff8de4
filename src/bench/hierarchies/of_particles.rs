//! Hierarchies of particles, compared by the sums of mass along lines of sight.

use super::in_memory::{self, Splat};
use super::pictures::{Shown, color_errors, sum_errors, views};
use super::report::{Outcome, Report, conclude, milliseconds, print_head, print_row};
use super::ways::{Data, Way};
use crate::bench::paged::{Drawn, Paged};
use crate::bench::process_memory::peak_memory;
use crate::bench::splat::Failure;
use crate::bench::{Arguments, Times};
use crate::build::{BuildOptions, build_source};
use crate::color::Accumulation;
use crate::color::composite::{Image, composite_at};
use crate::color::transfer::TransferFunction;
use crate::command_line::arguments::PictureSize;
use crate::command_line::progress_bar::Terminal;
use crate::cpu::{Extent, Method, Positions, SplatOptions, Splats, Sprite, draw};
use crate::hierarchy::{Kinds, Purpose};
use crate::look::{DataKind, LookPatch, Member};
use crate::mode::{LevelChoice, Levels as LevelKind, Plan};
use crate::model::{Covariance, Dataset, Kernel};
use crate::modes::column_density;
use crate::picture::Subject;
use crate::picture::source::{Wanted, particles};
use crate::store::{InMemory, Representative, Tree};
use crate::stream::first_nodes;
use crate::view::View;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What all pictures share.
pub(super) struct Bench<'a> {
    arguments: &'a Arguments,
    named: String,
    paged: Paged,
    /// The source's particles; `None` of page files, whose leaves stand for them.
    source: Option<InMemory>,
    /// Particles as splats, with what each is in memory.
    splats: Vec<Splat>,
    kernel: Kernel,
    built: Option<(f64, Option<u64>)>,
    _folder: tempfile::TempDir,
}

impl<'a> Bench<'a> {
    pub fn new(path: &Path, named: String, arguments: &'a Arguments) -> Result<Bench<'a>, Failure> {
        let temporary = tempfile::tempdir()?;
        let is_source = matches!(DataKind::of(path)?, DataKind::Source);
        let (page_file, built): (PathBuf, _) = match is_source {
            false => (path.to_owned(), None),
            true => {
                let out = temporary.path().join("hierarchies.df");
                let hierarchies = Kinds::of_particles();
                let options = BuildOptions { hierarchies, memory: arguments.memory, ..BuildOptions::default() };
                let start = Instant::now();
                build_source(path, &Default::default(), &options, &out, &())?;
                (out, Some((start.elapsed().as_secs_f64(), peak_memory("self"))))
            }
        };
        let mut paged = Paged::open(&page_file)?;
        let source: Option<Dataset> = match is_source {
            true => Some(particles(&[Member::new(path)], &Wanted::of([&LookPatch::default()], None), &Terminal)?.1),
            false => None,
        };
        let metadata = paged.file.metadata();
        let kernel = metadata.kernel;
        // Any view of all leaves.
        let all = views(metadata.bounds(), 1, (64, 64))?[0].0;
        let leaves = paged.scene.converge_blocking(&all, 0.0)?;
        let splats = in_memory::splats(&leaves.nodes, metadata);
        let source = source.map(InMemory::new);
        Ok(Bench { arguments, named, paged, source, splats, kernel, built, _folder: temporary })
    }

    pub fn run(mut self, ways: &[Way], folder: &Path) -> Result<Report, Failure> {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let options = &self.arguments.hierarchies;
        let PictureSize { width, height } =
            self.arguments.flight.size.unwrap_or(PictureSize { width: 512, height: 512 });
        let bounds = self.paged.file.metadata().bounds();
        let particles = self.paged.file.metadata().particles();
        let all_views = views(bounds, options.views.into(), (width, height))?;
        let transfer = TransferFunction::preset(column_density::MODE.transfer[0]).unwrap_or_default();
        let (mut outcomes, mut shown): (Vec<Outcome>, Vec<Shown>) = (Vec::new(), Vec::new());
        print_head(&self.named);
        for (number, (view, _)) in all_views.iter().enumerate() {
            let exact = self.exact(view)?;
            let levels = transfer.levels(&exact);
            let truth = composite_at(&exact, &transfer, &levels);
            for way in ways {
                for budget in &options.budgets {
                    let budget = budget.of(particles);
                    let drawn = self.draw(*way, view, budget)?;
                    let image = composite_at(&drawn.sums, &transfer, &levels);
                    let outcome = self.outcome(*way, budget, number, &drawn, (&exact, &truth), &image);
                    print_row(&outcome);
                    if number == 0 {
                        shown.push(Shown { outcome: outcome.clone(), image });
                    }
                    outcomes.push(outcome);
                }
            }
            if number == 0 {
                Shown::write(folder, options.budgets.len() as u32, &truth, &shown)?;
            }
        }
        let best = conclude(folder, &outcomes)?;
        Ok(Report {
            source: self.named,
            particles,
            size: [width, height],
            views: all_views.iter().map(|(_, camera)| *camera).collect(),
            outcomes,
            best,
        })
    }

    /// The picture of the source's particles.
    fn exact(&mut self, view: &View) -> Result<Accumulation, Failure> {
        let depiction = self.paged.depiction(LevelChoice { levels: LevelKind::Splats, ..LevelChoice::default() })?;
        let (nodes, metadata) = match &self.source {
            Some(source) => (first_nodes(source, view)?, source.metadata()),
            None => {
                self.paged.scene.purpose = Purpose::Splats;
                (self.paged.scene.converge_blocking(view, 0.0)?.nodes, self.paged.file.metadata())
            }
        };
        let transfer = TransferFunction::default();
        let subject = Subject::new(metadata, &depiction, &transfer, 1.0);
        Ok(subject.draw_nodes(view, &nodes, &Plan::default())?.sums(depiction.mode)?.0)
    }

    fn draw(&mut self, way: Way, view: &View, budget: u64) -> Result<Drawn, Failure> {
        let choice =
            |levels, representative, splats| LevelChoice { levels, representative, splats, ..LevelChoice::default() };
        let (ellipsoid, round) = (Representative::Ellipsoid, Representative::Round);
        match way {
            Way::Sample => {
                let share = (budget as f64 / self.paged.file.metadata().particles() as f64).min(1.0) as f32;
                self.paged(choice(LevelKind::Splats, ellipsoid, None), view, 0.0, Plan { share, ..Plan::default() })
            }
            Way::OctreeTau => self.paged(choice(LevelKind::Splats, ellipsoid, None), view, 0.8, Plan::default()),
            Way::Octree => self.paged(choice(LevelKind::Splats, ellipsoid, Some(budget)), view, 0.8, Plan::default()),
            Way::Pca => self.paged(choice(LevelKind::Clusters, ellipsoid, Some(budget)), view, 0.8, Plan::default()),
            Way::PcaRound => self.paged(choice(LevelKind::Clusters, round, Some(budget)), view, 0.8, Plan::default()),
            Way::PcaGaussian => self.with_footprint(Sprite::Gaussian, view, budget),
            Way::PcaDisc => self.with_footprint(Sprite::Disc, view, budget),
            Way::PcaPixel => self.with_footprint(Sprite::Pixel, view, budget),
            Way::OctreeVolume => Ok(self.of_splats(&in_memory::in_cells(&self.splats, budget as usize), None, view)?),
            Way::PcaFree => {
                let (splats, covariances) = in_memory::free(&self.splats, budget as usize, self.kernel);
                Ok(self.of_splats(&splats, Some(&covariances), view)?)
            }
            Way::PcaPublished => {
                Ok(self.of_splats(&in_memory::published(&self.splats, budget as usize, self.kernel), None, view)?)
            }
            Way::Wavelet | Way::WaveletRound | Way::Mip => Err(Data::Particles.refusal(way, &self.named)),
        }
    }

    /// Draws clusters with another footprint.
    fn with_footprint(&mut self, sprite: Sprite, view: &View, budget: u64) -> Result<Drawn, Failure> {
        let choice =
            LevelChoice { levels: LevelKind::Clusters, splats: Some(budget), sprite, ..LevelChoice::default() };
        self.paged(choice, view, 0.8, Plan::default())
    }

    /// Draws nodes of the page file.
    fn paged(&mut self, choice: LevelChoice, view: &View, tau: f64, plan: Plan) -> Result<Drawn, Failure> {
        self.paged.draw(choice, view, tau, plan, self.arguments.repeat)
    }

    /// Draws splats that are in memory, ellipsoids where they have second moments.
    fn of_splats(&self, splats: &[Splat], shapes: Option<&[Covariance]>, view: &View) -> Result<Drawn, Failure> {
        let positions: Vec<[f64; 3]> = splats.iter().map(|splat| splat.place).collect();
        let h: Vec<f32> = splats.iter().map(|splat| splat.smoothing_length as f32).collect();
        let weight: Vec<f32> = splats.iter().map(|splat| splat.mass as f32).collect();
        let extent = shapes.map_or(Extent::World(&h), Extent::Ellipsoids);
        let batch = Splats::new(Positions::World(&positions), extent, &weight, None)?;
        let options = SplatOptions { kernel: self.kernel, method: Method::Pyramid, ..SplatOptions::default() };
        let (mut times, mut sums) = (Vec::new(), Accumulation::default());
        for _ in 0..self.arguments.repeat {
            let start = Instant::now();
            sums = draw(view, &[batch], &options);
            times.push(start.elapsed());
        }
        let splats = splats.len() as u64;
        Ok(Drawn { sums, splats, nodes: Vec::new(), select_ms: None, times, error_bound: None })
    }

    fn outcome(
        &self,
        hierarchy: Way,
        budget: u64,
        view: usize,
        drawn: &Drawn,
        (exact, truth): (&Accumulation, &Image),
        image: &Image,
    ) -> Outcome {
        let [error_l1, error_l2, psnr] = sum_errors(&drawn.sums, exact);
        let pages: BTreeSet<_> = drawn.nodes.iter().map(|node| node.node.page).collect();
        let is_paged = drawn.select_ms.is_some();
        Outcome {
            hierarchy,
            budget,
            view,
            splats: drawn.splats,
            nodes: drawn.nodes.len(),
            bytes_read: is_paged.then(|| pages.iter().map(|page| self.paged.file.page_bytes(*page)).sum()),
            bytes_file: is_paged.then(|| self.paged.file.bytes()),
            build_s: self.built.map(|(seconds, _)| seconds),
            build_peak_memory: self.built.and_then(|(_, memory)| memory),
            select_ms: drawn.select_ms,
            frame_ms: milliseconds(Times::of(drawn.times.clone())),
            error_l1,
            error_l2,
            error_color: color_errors(image, truth),
            psnr,
            error_bound: drawn.error_bound,
        }
    }
}
