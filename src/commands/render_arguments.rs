//! What the command line of `deepfield render` says, and what it comes to over a scene and a configuration.

use super::annotate::AnnotateOptions;
use super::arguments::{Given, PictureSize, family_name, mode_name, not_negative, positive, transfer_named, vector};
use super::derive_options::DeriveOptions;
use super::heights::{BeforeOptions, HeightsOptions, SpacingOptions, TextureOptions};
use super::light_options::LightOptions;
use super::projection_options::ProjectionOptions;
use super::request::Request;
use super::usage;
use crate::build::default_memory;
use crate::color::composite::Background;
use crate::color::transfer::TransferFunction;
use crate::cpu::Method;
use crate::hierarchy::spacetime::Interpolation;
use crate::import::file_of_step;
use crate::look::{
    Attribute, Backend, CameraConfig, LookPatch, Member, MemberKind, PictureConfig, SceneFile, Shot, check_derived,
    data_file, is_scene_file, say,
};
use crate::mode::{Mode, PathsOf, SettingValue, Settings, levels, lod_budget};
use crate::model::{FamilyName, ReadMethod, When, is_url};
use crate::modes;
use crate::modes::samples::ERROR_VALUE;
use crate::picture::SessionOptions;
use crate::view::{CutSettings, Periodic};
use glam::DVec3;
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Renders a picture of a snapshot, catalogue, image, volume, height field, page file or run.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(after_help = "Examples:
  deepfield render snapshot_099.hdf5 -o box.png
  deepfield render galaxy.df -o disk.png --mode density-squared --attribute temperature --size 1920x1080
  deepfield render galaxy.df -o disk.exr --raw column.npy --mode column-density --eye 0,0,50 --target 0,0,0 --ortho 40
  deepfield render galaxy.df -o disk.png --backend cpu --error-px 0.5 --json -
  deepfield render galaxy.df -o figure.png --size 3840x2160 --annotate=legend,scale-bar,axes --caption \"Snapshot 99\"
  deepfield render merger.hdf5 -o stars.png --family gas --mode volume-isosurface --exact
  deepfield render box.df -o dome.png --eye 25,25,25 --target 25,25,0 --projection dome --tilt 20 --size 4096x4096
  deepfield render box.df -o pair.png --stereo off-axis --eye-separation 0.2 --zero-parallax 6
  deepfield render run.df --time step:12 -o then.png         a step of a run; also 9.6, z:1.5, a:0.4, last
  deepfield render run.df --time step:12 --mode volume --paths all -o both.png
  deepfield render dem.tif -o hill.png --set contours=20.0   measured heights, with a line every 20
  deepfield render dem.df -o slope.png --attribute slope --set exaggeration=3.0
  deepfield render after.df --before before.tif -o change.png          what has changed, over the later surface
  deepfield render dem.df -o low.png --eye 100,200,0 --target 900,200,0 --set clearance=2.0    2 above the ground at least
  deepfield render moon.tif --map globe:moon --with stars.csv -o moon.png    heights among particles: depth decides
  deepfield render snapshot_099.hdf5 -o curl.png --family gas --derive vorticity --attribute vorticity
  deepfield render hipparcos.csv -o sky.png --bloom 0.4 --bloom-radius 0.03    bright stars glow
  deepfield render galaxy.scene.ron -o disk.png              what the window has saved with Ctrl+S")]
pub struct Arguments {
    /// The source, page file or run, the URL of a built file, or a scene file.
    pub path: PathBuf,
    /// When, of a run: a time, step:12, z:1.5, a:0.4 or last [default: the first step; in the mode paths without a lead the last].
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true)]
    pub time: Option<When>,
    /// How particles of a run move between steps: auto (along splines, fading where steps are too far apart for them), hermite, linear,
    /// fade or hold (the step before) [default: auto].
    #[arg(long, value_name = "HOW")]
    pub interpolation: Option<Interpolation>,
    /// Whose pathlines are drawn, of a run: all, none, or a selection of the scene by its name; settings in a scene or --config, as
    /// paths: (level: 0) [default: none; all in the mode paths].
    #[arg(long, value_name = "all|NAME|none")]
    pub paths: Option<PathsOf>,
    /// Another source or page file in the same picture, in the first one's units; @X,Y,Z says where its origin lies there and *SCALE
    /// how many of the first one's lengths one of its own is. Can be given several times. Of particles, volumes, images and heights
    /// depth decides what hides what.
    #[arg(long, value_name = "FILE[@X,Y,Z[*SCALE]]")]
    pub with: Vec<Member>,
    /// Where the picture goes: .png (colours) or .exr (the raw channels P and S).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Also save the raw accumulation P as a float32 NumPy array, row 0 at the top, rounded to 1e-7 of its largest value, so that pixels with
    /// nothing in them may be that little below 0; for volumes premultiplied linear RGBA; for cross-section the field's values, NaN where nothing
    /// is; for heights depth, x, y, height, row, column and coverage at the middle of each pixel as float64.
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
    /// The direction that points up in the picture [default: 0,1,0, of heights 0,0,1; for who looks straight along that z, of heights y].
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
    /// Largest displacement of a particle on screen, pixels; a quarter of it where an attribute colours density-squared
    /// [default: 0.8].
    #[arg(long, value_name = "TAU", value_parser = positive)]
    pub error_px: Option<f64>,
    /// Levels of detail that are drawn: merged particles (splats), or clusters with a shape of a file built with --hierarchy pca
    /// [default: auto, clusters where --splats, --error-picture or --frame-ms is given].
    #[arg(long, value_name = "KIND", value_parser = ["auto", "splats", "clusters"], conflicts_with_all = ["exact", "reference"])]
    pub levels: Option<String>,
    /// Draw at most N splats, those that show most.
    #[arg(long, value_name = "N", value_parser = splat_count, conflicts_with_all = ["exact", "reference", "error_px"])]
    pub splats: Option<f64>,
    /// Refine clusters until the picture's relative L1 error is thought to be at most E.
    #[arg(long, value_name = "E", value_parser = positive, conflicts_with_all = ["exact", "reference", "error_px"])]
    pub error_picture: Option<f64>,
    /// Of images and volumes: draw as few points as leave values so near to the samples' [default: half a step of whole numbers].
    #[arg(long, value_name = "E", value_parser = positive, conflicts_with_all = ["exact", "reference", "splats"])]
    pub error_value: Option<f64>,
    /// Draw as many clusters as take T milliseconds on this machine, found by trying.
    #[arg(long, value_name = "T", value_parser = positive,
          conflicts_with_all = ["exact", "reference", "error_px", "error_picture"])]
    pub frame_ms: Option<f64>,
    /// Draw every source particle at full precision: no level of detail, no quantisation.
    #[arg(long, conflicts_with = "error_px")]
    pub exact: bool,
    /// Draw every source particle, and evaluate the integral over each pixel's area: slow, what other pictures are compared with.
    #[arg(long, conflicts_with_all = ["error_px", "exact", "overdraw"])]
    pub reference: bool,
    /// A setting of the mode (`deepfield modes` lists them), its value in RON: radius=3.0, iso-colors='["#ff8000"]'. Can be given
    /// several times.
    #[arg(long, value_name = "NAME=VALUE", value_parser = setting_value)]
    pub set: Vec<(String, SettingValue)>,
    /// Drop particles fainter than 1/N of the darkest colour's P, with their light; 0: none [default: 0].
    #[arg(long, value_name = "N", value_parser = not_negative)]
    pub presence: Option<f64>,
    /// Draw a weighted sample of the particles whose mean colour error stays below E of 255; 0: all of them [default: 0].
    #[arg(long, value_name = "E", value_parser = not_negative)]
    pub thinning: Option<f64>,
    /// Also save a picture of how many splats lie over each pixel: 0 black, 500 magenta, 3000 red.
    #[arg(long, value_name = "FILE.png")]
    pub overdraw: Option<PathBuf>,
    /// Do not drop particles outside the view one by one: to measure what that saves.
    #[arg(long)]
    pub no_culling: bool,
    /// How the page file is read; mapped only where nobody writes it meanwhile.
    #[arg(long, value_enum, value_name = "HOW", default_value_t)]
    pub read: ReadMethod,
    /// Draw so many times and report median times.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Memory that pages of particles may take, with what is drawn of them at a time: sums that need more are drawn in passes and volumes in
    /// slabs, the same picture; all else is drawn coarser, and told [default: half of what is free]. And what the samples of an image or a volume may
    /// take; of larger ones one in two, three, ... along each axis is drawn [default: 4GiB]. And what chunks of heights may take, which are coarser
    /// where that is too little [default: 1GiB].
    #[arg(long, value_name = "BYTES", value_parser = super::arguments::bytes)]
    pub memory: Option<u64>,
    /// Threads of the CPU's part [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write statistics as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "STATS.json")]
    pub json: Option<PathBuf>,
    /// What is written into the picture.
    #[command(flatten)]
    pub annotate: AnnotateOptions,
    /// What colours mean: a preset (density, density-hue, stars, grey, terrain, land, signed, cyclic, volume, volume-hue, volume-values) or a
    /// RON file like those in assets/transfer [default: the mode's].
    #[arg(long, value_name = "NAME|FILE.ron", value_parser = transfer_named)]
    pub transfer: Option<TransferFunction>,
    /// What is derived.
    #[command(flatten)]
    pub derive: DeriveOptions,
    /// What is behind the picture: black, transparent (an alpha channel) or a colour #rrggbb [default: black].
    #[arg(long, value_name = "COLOUR")]
    pub background: Option<Background>,
    /// How light is exposed and spreads.
    #[command(flatten)]
    pub light: LightOptions,
    /// What is said of heights.
    #[command(flatten)]
    pub heights: HeightsOptions,
    /// How far their samples are apart.
    #[command(flatten)]
    pub spacing: SpacingOptions,
    /// A photo over them.
    #[command(flatten)]
    pub texture: TextureOptions,
    /// Earlier heights.
    #[command(flatten)]
    pub before: BeforeOptions,
    /// How degrees of heights become places: plate, local, globe or globe:BODY such as globe:moon [default: globe from 20 degrees on].
    #[arg(long, value_name = "MAP")]
    pub map: Option<String>,
    /// The widest hole of heights that --set holes=filled fills, in cells, or with --set gap-unit=lengths in the unit of x and y; 0: any.
    #[arg(long, value_name = "GAP", value_parser = not_negative, allow_hyphen_values = true)]
    pub largest_gap: Option<f64>,
}

impl Arguments {
    /// The request that the command line comes to, over the configuration and the scene that it names.
    ///
    /// # Errors
    /// Where a file cannot be found or read, or what is asked does not go together; [`clap::Error`] for a setting that the mode has
    /// not, or a value that it does not take.
    pub fn request(&self) -> Result<Request, Failure> {
        let config = self.config.as_deref().map(PictureConfig::read).transpose()?.unwrap_or_default();
        let path = data_file(&self.path)?;
        let (base, mut members) = match named(&path, self.scene.as_deref()) {
            Some((scene, data)) => open_scene(&scene, data)?,
            None => (Shot::default(), vec![Member::new(path)]),
        };
        for member in &self.with {
            members.push(member.resolved()?);
        }
        let said = self.before.with(self.texture.with(self.heights.said(&self.spacing.spacing)));
        say(&mut members, &self.derive.with(said));
        check_derived(&members)?;
        let mut shot = self.over(config.clone(), base)?;
        self.light.set(&mut shot.look);
        self.set_values(&mut shot.look)?;
        if let Some(map) = &self.map {
            shot.look.settings.0.insert("map".into(), SettingValue::Name(map.clone()));
        }
        (shot.surround, shot.stereo) = self.projection.over(shot.surround, shot.stereo)?;
        for member in &mut members {
            member.families = member.families.take().or_else(|| shot.look.families.clone());
        }
        let named =
            self.config.as_deref().or(members.first().map(|member| member.path.as_path())).unwrap_or(&self.path);
        let budget = config.residency.budget_mib.map(|mebibytes| mebibytes << 20);
        let options = SessionOptions {
            named: named.to_owned(),
            family: self.family.or(config.family),
            backend: self.backend.or(config.backend),
            exact: match (self.exact, self.reference) {
                (_, true) => Some(Method::Exact),
                (true, false) => Some(Method::Pyramid),
                (false, false) => None,
            },
            read: self.read,
            overdraw: self.overdraw.clone(),
            repeat: self.repeat,
            memory: self.memory,
            page_memory: Some(self.memory.or(budget).unwrap_or_else(default_memory)),
            chunk_memory: self.memory.or(budget),
            raw: self.raw.is_some(),
        };
        Ok(Request { members, shot, options })
    }

    /// The picture that the command line says, where it says nothing the configuration, and where that says nothing the scene.
    fn over(&self, config: PictureConfig, base: Shot) -> Result<Shot, Failure> {
        let PictureConfig { mut look, volume, .. } = config;
        let mode = self.mode.or(look.mode).or(base.look.mode);
        // What light a volume emits and absorbs is its own; a surface has colours as sums have.
        if mode.is_some_and(|mode| mode.is_light() && !mode.takes_surfaces()) {
            look.transfer = volume;
        }
        if let Some(mode) = self.mode {
            // A file's colours are for whatever is drawn; its settings are those of its mode.
            let of_heights = self.kinds().any(|kind| kind == MemberKind::Heights);
            let of_heights =
                if of_heights { look.settings.of_mode(&modes::surface::MODE) } else { Settings::default() };
            (look.mode, look.settings) = (Some(mode), look.settings.of_mode(mode));
            // Heights that are drawn among what the mode draws have their own.
            look.settings.0.extend(of_heights.0);
        }
        let mut look = look.then(&LookPatch {
            attribute: self.attribute.clone().map(Attribute::Named),
            transfer: self.transfer.clone(),
            error_px: self.error_px,
            background: self.background,
            time: self.time,
            interpolation: self.interpolation,
            ..LookPatch::default()
        });
        look.annotations = self.annotate.over(look.annotations.or(base.look.annotations.clone()));
        look.cut = look.cut.filter(|cut| *cut != CutSettings::default());
        let [eye, target, up] = [self.eye, self.target, self.up].map(|place| place.map(|place| place.to_array()));
        let mut shot = base.then(Shot {
            look,
            camera: config.camera.then(CameraConfig { eye, target, up, fov: self.fov, ortho: self.ortho }),
            size: self.size.map(|size| (size.width, size.height)).or(config.size),
            stereo: config.stereo,
            labels: self.annotate.labels.clone().or(config.catalogue),
            ..Shot::default()
        });
        shot.surround = config.projection.unwrap_or(shot.surround);
        if let Some(of) = &self.paths {
            shot.look.paths.get_or_insert_default().of = Some(of.clone());
        }
        if let Some(periodic) = self.periodic {
            shot.look.cut.get_or_insert_default().periodic = periodic;
        }
        Ok(shot)
    }

    /// The options of particles alone that are no settings of a mode, and which of them are given.
    pub fn of_particles(&self) -> [Given; 7] {
        [
            ("--time", self.time.is_some()),
            ("--interpolation", self.interpolation.is_some()),
            ("--paths", self.paths.is_some()),
            ("--family", self.family.is_some()),
            ("--periodic", self.periodic.is_some()),
            ("--reference", self.reference),
            ("--overdraw", self.overdraw.is_some()),
        ]
    }

    /// What each of the datasets is drawn as.
    fn kinds(&self) -> impl Iterator<Item = MemberKind> {
        let mut members = vec![Member::new(&self.path)];
        members.extend(self.with.iter().cloned());
        say(&mut members, &self.heights.said(&[]));
        members.into_iter().map(|member| member.kind())
    }

    /// The modes that a look's settings may be of: its own; where it names none the data's usual one, which is one of these.
    fn possible_modes(&self, look: &LookPatch) -> Vec<&'static Mode> {
        let of_particles = || {
            let of_fields = modes::all().into_iter().filter(|mode| !mode.weight_attributes.is_empty());
            of_fields.chain([modes::first()])
        };
        let usual = |kind: MemberKind| match kind {
            MemberKind::Heights => vec![&modes::surface::MODE],
            MemberKind::Field => vec![modes::of_fields(2), modes::of_fields(3)],
            MemberKind::Particles => of_particles().collect(),
        };
        let kinds: Vec<MemberKind> = self.kinds().collect();
        let first = || kinds.first().map_or_else(Vec::new, |kind| usual(*kind));
        let mut possible: Vec<&'static Mode> = look.mode.map_or_else(first, |mode| vec![mode]);
        if kinds.len() > 1 && kinds.iter().any(|kind| *kind != MemberKind::Particles) {
            // Of what else is in the picture, too.
            possible.extend(kinds.iter().flat_map(|kind| usual(*kind)));
        }
        possible
    }

    /// Sets what the command line says of the settings of the mode, and of what may be left undrawn.
    fn set_values(&self, look: &mut LookPatch) -> Result<(), Failure> {
        let budget = [
            (&lod_budget::PRESENCE, self.presence.map(SettingValue::Number)),
            (&lod_budget::THINNING, self.thinning.map(SettingValue::Number)),
            (&levels::LEVELS, self.levels.clone().map(SettingValue::Name)),
            (&levels::SPLATS, self.splats.map(SettingValue::Number)),
            (&levels::ERROR_PICTURE, self.error_picture.map(SettingValue::Number)),
            (&levels::FRAME_MS, self.frame_ms.map(SettingValue::Number)),
            (&ERROR_VALUE, self.error_value.map(SettingValue::Number)),
            (&modes::surface::LARGEST_GAP, self.largest_gap.map(SettingValue::Number)),
            (&lod_budget::CULLING, self.no_culling.then_some(SettingValue::Flag(false))),
        ];
        let budget = budget.into_iter().filter_map(|(setting, value)| Some((setting.name.to_owned(), value?)));
        let possible = self.possible_modes(look);
        let mode = match &possible[..] {
            [only] => only.name,
            _ => look.mode.map_or("the data's usual mode", |mode| mode.name),
        };
        let (is_usual, file) = (look.mode.is_none() && !is_url(&self.path), file_of_step(&self.path));
        let setting_of = |name: &str| {
            let settings = || possible.iter().flat_map(|mode| mode.all_settings());
            settings().find(|setting| setting.name == name).ok_or_else(|| {
                // What is not there has no usual mode.
                if let (true, Err(error)) = (is_usual, std::fs::metadata(file)) {
                    return format!("{}: {error}", file.display()).into();
                }
                let mut names: Vec<&str> = settings().map(|own| own.name).collect();
                names.sort_unstable();
                names.dedup();
                let expected = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
                usage(format!("{mode} has no setting {name}, expected {expected}"))
            })
        };
        if look.mode.is_none() && self.config.is_some() {
            // A configuration that names no mode has settings of any.
            look.settings.0.keys().try_for_each(|name| setting_of(name).map(|_| ()))?;
        }
        for (name, value) in budget.chain(self.set.iter().cloned()) {
            let setting = setting_of(&name)?;
            setting.check(&value).map_err(|error| usage(error.to_string()))?;
            let values = if lod_budget::is_common(&name) { &mut look.budget } else { &mut look.settings };
            values.set(setting, value);
        }
        Ok(())
    }
}

pub(super) fn splat_count(text: &str) -> Result<f64, String> {
    let count = text.parse::<f64>().ok().filter(|count| (1.0..=1e12).contains(count));
    count.map(f64::floor).ok_or_else(|| "expected a number from 1".into())
}

/// `NAME=VALUE`; a value that is one word needs no quotes.
pub(super) fn setting_value(text: &str) -> Result<(String, SettingValue), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let is_word = value.starts_with(char::is_alphabetic) && value.chars().all(|c| c.is_alphanumeric() || c == '-');
    let value = match ron::from_str(value) {
        Ok(value) => value,
        Err(_) if is_word => SettingValue::Name(value.to_owned()),
        Err(error) => return Err(format!("{}: expected a number, true, false, a name or a list", error.code)),
    };
    Ok((name.trim().to_owned(), value))
}

/// The scene and the data that the command line names: a scene's own data where it names no other. `None` without a scene.
fn named(path: &Path, scene: Option<&Path>) -> Option<(PathBuf, Option<PathBuf>)> {
    match scene {
        Some(scene) => Some((scene.to_owned(), (!path.as_os_str().is_empty()).then(|| path.to_owned()))),
        None => is_scene_file(path).then(|| (path.to_owned(), None)),
    }
}

/// What a scene says, with its data or in its place other data.
fn open_scene(path: &Path, data: Option<PathBuf>) -> Result<(Shot, Vec<Member>), Failure> {
    let mut scene = SceneFile::read(path)?;
    if let Some(film) = &mut scene.film {
        let folder = path.parent().unwrap_or(Path::new(""));
        film.overlay.images.iter_mut().for_each(|image| image.path = folder.join(&image.path));
    }
    let members = match data {
        // Other data in the light of the scene: its families are those that the scene's first dataset shows.
        Some(data) => {
            let families = scene.datasets.first().and_then(|dataset| dataset.families.clone());
            vec![Member { families, ..Member::new(data) }]
        }
        None => {
            let located = scene.locate(path)?;
            located.notes.iter().for_each(|note| eprintln!("deepfield: {note}"));
            located.members
        }
    };
    Ok((Shot::of_scene(scene, path), members))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::{Camera, DatasetRef};
    use crate::view::Surround;

    fn config(text: &str) -> PictureConfig {
        PictureConfig::parse("p.ron", text).unwrap()
    }

    #[test]
    fn the_examples_are_read_and_the_command_line_overrides_them() {
        let own = Arguments { error_px: Some(3.0), fov: Some(20.0), ..Arguments::default() };
        let shot = own.over(config(include_str!("../../configs/picture.ron")), Shot::default()).unwrap();
        assert_eq!(shot.look.mode, modes::find("density-squared"));
        assert_eq!((shot.look.error_px, shot.camera.fov, shot.camera.ortho), (Some(3.0), Some(20.0), None));
        assert!(shot.look.transfer.is_some());
        let volume = config(include_str!("../../configs/volume.ron"));
        let shot = Arguments::default().over(volume, Shot::default()).unwrap();
        assert!(shot.look.transfer.is_some() && shot.look.mode.is_some_and(|mode| mode.is_light()));
    }

    #[test]
    fn a_configuration_overrides_the_projection_of_the_scene() {
        let dome = Shot { surround: Surround::Dome { aperture: 210.0, tilt: 15.0 }, ..Shot::default() };
        let over = |text: &str| Arguments::default().over(config(text), dome.clone()).unwrap().surround;
        assert_eq!(over("(mode: \"points\")"), dome.surround);
        assert_eq!(over("(projection: flat)"), Surround::Flat);
        assert_eq!(over("(projection: equirectangular)"), Surround::Equirectangular);
    }

    #[test]
    fn the_command_line_overrides_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("box.df");
        std::fs::write(&data, b"data").unwrap();
        let path = folder.path().join("a.scene.ron");
        let mut scene = SceneFile::new(vec![DatasetRef::of(&data, &path)]);
        scene.look.mode = modes::find("points");
        scene.look.settings.0.insert("radius".into(), SettingValue::Number(3.0));
        scene.look.attribute = Some(Attribute::None);
        scene.size = Some((300, 200));
        scene.labels = Some("groups.hdf5".into());
        scene.camera =
            Some(Camera { eye: [1.0, 2.0, 3.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 33.0, ortho: Some(5.0) });
        scene.write(&path).unwrap();

        let arguments = Arguments { path: path.clone(), ..Arguments::default() };
        let all = arguments.request().unwrap();
        assert_eq!(all.members[0].path, folder.path().join("box.df"));
        assert!(all.shot.look.is_plain() && all.shot.size == Some((300, 200)) && all.shot.look.settings.0.len() == 1);
        assert_eq!((all.shot.camera.ortho, all.shot.camera.eye), (Some(5.0), Some([1.0, 2.0, 3.0])));
        assert_eq!(all.shot.labels, Some(folder.path().join("groups.hdf5")));
        let (mode, attribute) = (modes::find("volume"), Some("mass".to_owned()));
        let own = Arguments { fov: Some(20.0), mode, attribute, read: ReadMethod::Mapped, ..arguments };
        let some = own.request().unwrap();
        assert_eq!((all.options.read, some.options.read), (ReadMethod::Positioned, ReadMethod::Mapped));
        assert_eq!((some.shot.camera.fov, some.shot.camera.ortho), (Some(20.0), None));
        assert!(some.shot.look.settings.0.is_empty() && !some.shot.look.is_plain(), "settings of another mode");
        // The scene of other data.
        let other = Arguments { scene: Some(path), path: "other.df".into(), ..Arguments::default() };
        assert_eq!(other.request().unwrap().members[0].path, Path::new("other.df"));
    }

    #[test]
    fn settings_are_those_of_the_mode() {
        let with = |mode: &str, set: &str| {
            let set = vec![setting_value(set)?];
            let mut look = LookPatch { mode: modes::find(mode), ..LookPatch::default() };
            let own = Arguments { set, ..Arguments::default() };
            own.set_values(&mut look).map(|()| look).map_err(|error| error.to_string())
        };
        assert_eq!(with("points", "radius=3").unwrap().settings.0["radius"], SettingValue::Number(3.0));
        assert_eq!(with("", "radius=3.5").unwrap().settings.0["radius"], SettingValue::Number(3.5));
        assert_eq!(
            with("isosurface", "kernel=poly6").unwrap().settings.0["kernel"],
            SettingValue::Name("poly6".into())
        );
        assert_eq!(with("points", "presence=9").unwrap().budget.0["presence"], SettingValue::Number(9.0));
        let gap = |mode: &str| {
            let mut look = LookPatch { mode: modes::find(mode), ..LookPatch::default() };
            let own = Arguments { largest_gap: Some(5.0), ..Arguments::default() };
            own.set_values(&mut look).map(|()| look).map_err(|error| error.to_string())
        };
        assert_eq!(gap("surface").unwrap().settings.0["largest-gap"], SettingValue::Number(5.0));
        assert!(gap("points").unwrap_err().contains("points has no setting largest-gap"));
        for (mode, set, expected) in [
            (
                "points",
                "radios=3",
                "points has no setting radios, expected blend, culling, error-picture, footprint, frame-ms, levels, order, presence, radius",
            ),
            ("points", "radius=99", "radius is 99, expected a number from 0.5 to 30"),
            ("volume", "presence=9", "volume has no setting presence"),
            ("points", "radius", "expected NAME=VALUE"),
            ("points", "radius=(", "expected a number, true"),
        ] {
            let message = with(mode, set).unwrap_err();
            assert!(message.contains(expected), "{set}: {message}");
        }
    }
}
