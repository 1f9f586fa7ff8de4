//! What the command line of `deepfield render` says, and what a scene or a tour adds to it.

use super::annotate::AnnotateOptions;
use super::arguments::{PictureSize, family_name, mode_name, not_negative, positive, transfer_named, vector};
use super::projection_options::ProjectionOptions;
use crate::annotate::Annotations;
use crate::color::composite::Background;
use crate::color::transfer::TransferFunction;
use crate::explore::SelectionSet;
use crate::import::ImportError;
use crate::look::{Film, Member, data_file};
use crate::mode::{Mode, SettingKind, SettingValue, Settings, economy};
use crate::model::FamilyName;
use crate::view::{CutSettings, Periodic, Stereo, Surround};
use glam::DVec3;
use std::path::PathBuf;

/// Renders a picture of a snapshot, catalogue or page file.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield render snapshot_099.hdf5 -o box.png
  deepfield render galaxy.df -o disk.png --mode density-squared --attribute temperature --size 1920x1080
  deepfield render galaxy.df -o disk.exr --raw column.npy --mode column-density --eye 0,0,50 --target 0,0,0 --ortho 40
  deepfield render galaxy.df -o disk.png --backend cpu --error-px 0.5 --json -
  deepfield render galaxy.df -o figure.png --size 3840x2160 --annotate=legend,scale-bar,axes --caption \"Snapshot 99\"
  deepfield render merger.hdf5 -o stars.png --family gas --mode volume-isosurface --exact
  deepfield render box.df -o dome.png --eye 25,25,25 --target 25,25,0 --projection dome --tilt 20 --size 4096x4096
  deepfield render box.df -o pair.png --stereo off-axis --eye-separation 0.2 --zero-parallax 6
  deepfield render galaxy.scene.ron -o disk.png              what the window has saved with Ctrl+S")]
pub struct Arguments {
    /// The source or page file, or a scene file.
    pub path: PathBuf,
    /// Another source or page file in the same picture, in the first one's units; @X,Y,Z says where its origin lies there and *SCALE
    /// how many of the first one's lengths one of its own is. Can be given several times.
    #[arg(long, value_name = "FILE[@X,Y,Z[*SCALE]]")]
    pub with: Vec<Member>,
    /// Where the picture goes: .png (colours) or .exr (the raw channels P and S).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Also save the raw accumulation P as a float32 NumPy array, row 0 at the top; for volumes premultiplied linear RGBA.
    #[arg(long, value_name = "FILE.npy")]
    pub raw: Option<PathBuf>,
    /// Picture size in pixels [default: 1200x800].
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// What draws: compute or raster (a Vulkan, Metal or DX12 adapter), or cpu [default: the best there is].
    #[arg(long)]
    pub backend: Option<Backend>,
    /// Visualization mode; `deepfield modes` lists them [default: points for data with magnitudes, else column-density].
    #[arg(long, value_name = "NAME", value_parser = mode_name)]
    pub mode: Option<&'static Mode>,
    /// The family to draw: gas, dark, type2, type3, stars or black-holes; all without it.
    #[arg(long, value_name = "NAME", value_parser = family_name)]
    pub family: Option<FamilyName>,
    /// The attribute that colours the picture.
    #[arg(long, value_name = "NAME")]
    pub attribute: Option<String>,
    /// Settings in RON (see configs/picture.ron); options on the command line override them.
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    /// A scene file whose settings and camera are used for the data, whatever data it names itself.
    #[arg(long, value_name = "FILE.scene.ron")]
    pub scene: Option<PathBuf>,
    /// How a periodic box is drawn: once, wrapped (what one looks at is in the middle), or as many times along each axis as
    /// 3x3x1 says [default: once].
    #[arg(long, value_name = "HOW")]
    pub periodic: Option<Periodic>,
    /// Camera position in world units.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,
    /// The point looked at [default: the middle of the data, outliers left out].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub target: Option<DVec3>,
    /// The direction that points up in the picture [default: 0,1,0].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub up: Option<DVec3>,
    /// Vertical field of view of a perspective camera, degrees [default: 45].
    #[arg(long, value_name = "DEG", value_parser = positive)]
    pub fov: Option<f64>,
    /// An orthographic camera whose picture is this high, in world units.
    #[arg(long, value_name = "HEIGHT", value_parser = positive, conflicts_with = "fov")]
    pub ortho: Option<f64>,
    /// How directions become a picture, and for which eyes.
    #[command(flatten)]
    pub projection: ProjectionOptions,
    /// How directions become a picture where the options say nothing.
    #[arg(skip)]
    pub surround: Surround,
    /// A picture for two eyes where the options say nothing.
    #[arg(skip)]
    pub stereo_pair: Option<Stereo>,
    /// Largest displacement of a particle on screen, pixels [default: 0.8].
    #[arg(long, value_name = "TAU", value_parser = positive)]
    pub error_px: Option<f64>,
    /// Draw every source particle at full precision: no level of detail, no quantisation.
    #[arg(long, conflicts_with = "error_px")]
    pub exact: bool,
    /// Drop particles fainter than 1/N of the darkest colour's P, with their light; 0: none [default: 0].
    #[arg(long, value_name = "N", value_parser = not_negative)]
    pub presence: Option<f64>,
    /// Draw a weighted sample of the particles whose mean colour error stays below E of 255; 0: all of them [default: 0].
    #[arg(long, value_name = "E", value_parser = not_negative)]
    pub thinning: Option<f64>,
    /// Also save a picture of how many splats lie over each pixel: 0 black, 500 magenta, 3000 red.
    #[arg(long, value_name = "FILE.png", conflicts_with = "exact")]
    pub overdraw: Option<PathBuf>,
    /// Do not drop particles outside the view one by one: to measure what that saves.
    #[arg(long)]
    pub no_culling: bool,
    /// Draw so many times and report median times.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Threads of the CPU's part [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write statistics as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "STATS.json")]
    pub json: Option<PathBuf>,
    /// What is written into the picture.
    #[command(flatten)]
    pub annotate: AnnotateOptions,
    /// What is written into the picture where the options say nothing.
    #[arg(skip)]
    pub annotations: Option<Annotations>,
    /// Settings of the mode.
    #[arg(skip)]
    pub settings: Settings,
    /// The catalogue of a scene.
    #[arg(skip)]
    pub labels: Option<PathBuf>,
    /// A scene's selections.
    #[arg(skip)]
    pub selections: Vec<SelectionSet>,
    /// What a tour's picture has beyond a scene; its images' paths are complete.
    #[arg(skip)]
    pub film: Option<Film>,
    /// Where the first dataset of a scene lies, and which of its families are shown; its path is `path`.
    #[arg(skip)]
    pub first: Member,
    /// No attribute colours the picture, even if the mode has a usual one.
    #[arg(skip)]
    pub plain: bool,
    /// What is left out of the data and faded.
    #[arg(skip)]
    pub cut: CutSettings,
    /// What colours mean: a preset (density, density-hue, stars, volume, volume-hue) or a RON file like those in
    /// assets/transfer [default: the mode's].
    #[arg(long, value_name = "NAME|FILE.ron", value_parser = transfer_named)]
    pub transfer: Option<TransferFunction>,
    /// What volumes emit and absorb; the mode's own where it is `None`.
    #[arg(skip)]
    pub volume: Option<TransferFunction>,
    /// What is behind the picture: black, transparent (an alpha channel) or a colour #rrggbb [default: black].
    #[arg(long, value_name = "COLOUR")]
    pub background: Option<Background>,
}

impl Arguments {
    /// A picture of `path` in `output` with everything else as it is by default.
    pub fn new(path: PathBuf, output: PathBuf) -> Arguments {
        Arguments {
            path,
            output,
            raw: None,
            size: None,
            backend: None,
            mode: None,
            family: None,
            attribute: None,
            config: None,
            scene: None,
            periodic: None,
            eye: None,
            target: None,
            up: None,
            fov: None,
            ortho: None,
            projection: ProjectionOptions::default(),
            surround: Surround::Flat,
            stereo_pair: None,
            error_px: None,
            exact: false,
            presence: None,
            thinning: None,
            overdraw: None,
            no_culling: false,
            repeat: 1,
            threads: None,
            json: None,
            annotate: AnnotateOptions::default(),
            annotations: None,
            settings: Settings::default(),
            first: Member::default(),
            with: Vec::new(),
            labels: None,
            selections: Vec::new(),
            film: None,
            plain: false,
            cut: CutSettings::default(),
            transfer: None,
            volume: None,
            background: None,
        }
    }

    /// The datasets that are drawn.
    pub fn members(&self) -> Vec<Member> {
        let first = Member { path: self.path.clone(), ..self.first.clone() };
        std::iter::once(first).chain(self.with.iter().cloned()).collect()
    }

    /// The same with the files that are meant in place of folders.
    ///
    /// # Errors
    /// Where a folder holds no or more than one source.
    pub(super) fn with_files(self) -> Result<Arguments, ImportError> {
        let with = self.with.iter().map(Member::resolved).collect::<Result<_, _>>()?;
        Ok(Arguments { path: data_file(&self.path)?, with, ..self })
    }

    /// The same, with the options about what may be left out among the settings.
    pub(super) fn with_economy(mut self) -> Arguments {
        self.cut.periodic = self.periodic.unwrap_or(self.cut.periodic);
        for (setting, value) in [(&economy::PRESENCE, self.presence), (&economy::THINNING, self.thinning)] {
            if let SettingKind::Number { min, max, .. } = setting.kind
                && let Some(value) = value
            {
                self.settings.set(setting, SettingValue::Number(value.clamp(min, max)));
            }
        }
        if self.no_culling {
            self.settings.set(&economy::CULLING, SettingValue::Flag(false));
        }
        self
    }
}

/// What draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// Compute passes.
    Compute,
    /// Blended quads, for adapters without compute shaders; needs blending of 32-bit floats.
    Raster,
    /// The processor.
    Cpu,
}
