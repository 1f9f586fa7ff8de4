//! The picture that is asked for, from what a program says of it.

use super::Failure;
use crate::build::default_memory;
use crate::color::ColorMap;
use crate::color::composite::Background;
use crate::color::transfer::{Scale, TransferFunction, presets};
use crate::cpu::Method;
use crate::look::{
    Attribute, Backend, CameraConfig, DataKind, LookPatch, Member, PictureConfig, SceneFile, Shot, check_derived,
};
use crate::mode::{Mode, Setting, SettingValue, lod_budget};
use crate::model::{FamilyName, When};
use crate::modes;
use crate::picture::{AnySession, PictureError, Reporter, SessionOptions};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The largest picture, pixels along a side.
const LARGEST: u32 = 32_768;

/// A picture as a program asks for it. What it does not say is the configuration's, and what that does not say the program's own.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Asked {
    /// Settings in RON, as `deepfield render --config` reads them.
    pub config: Option<String>,
    /// What messages call these.
    pub config_name: String,
    /// Fields of a configuration in JSON, which hold over those in RON.
    pub fields: Map<String, Value>,
    /// A scene in RON, whose look, camera and size hold where nothing else is said; its own data is not opened, but what it says of it is said of the
    /// data that is open.
    pub scene: Option<String>,
    /// The file that it was read from.
    pub scene_file: Option<PathBuf>,
    /// Visualization mode.
    pub mode: Option<String>,
    /// The attribute that gives the hue.
    pub attribute: Option<String>,
    /// The one family that is drawn.
    pub family: Option<FamilyName>,
    /// Width and height, pixels.
    pub size: Option<(u32, u32)>,
    /// Where the camera stands.
    pub camera: CameraConfig,
    /// Whether every source particle is drawn at full precision.
    pub exact: bool,
    /// Largest displacement of a particle on screen, pixels.
    pub error_px: Option<f64>,
    /// Name or file of a transfer function, or its text in RON.
    pub transfer: Option<String>,
    /// The colours in place of those of the transfer function, or of its hue where it has one.
    pub color_map: Option<ColorMap>,
    /// How values are placed along them.
    pub color_scale: Option<Scale>,
    /// What is behind the picture.
    pub background: Option<Background>,
    /// When, of a run.
    pub time: Option<String>,
    /// Bytes that what is read may take.
    pub memory: Option<u64>,
    /// Settings of the mode.
    pub settings: BTreeMap<String, SettingValue>,
}

impl Asked {
    /// The shot, and how the datasets are opened and drawn; they get what the scene says of them, and the families that are asked for. What does not
    /// apply to them is told.
    ///
    /// # Errors
    /// What makes no sense, with what was expected.
    pub fn request(&self, members: &mut [Member], reporter: &dyn Reporter) -> Result<(Shot, SessionOptions), Failure> {
        self.check()?;
        let config = match &self.config {
            Some(text) => PictureConfig::parse(&self.config_name, text)?,
            None => PictureConfig::default(),
        };
        let config = config.then(PictureConfig::of_json(&self.fields)?);
        let base = match &self.scene {
            Some(text) => {
                let file = self.scene_file.as_deref().unwrap_or(Path::new("scene"));
                let scene = SceneFile::parse(&file.display().to_string(), text)?;
                scene.say_of(file, members).into_iter().for_each(|note| reporter.tell(note));
                check_derived(members)?;
                Shot::of_scene(scene, file)
            }
            None => Shot::default(),
        };
        let PictureConfig { look, volume, family, size, camera, projection, stereo, catalogue, residency, .. } = config;
        let families = look.families.clone();
        let mut look = self.look(&base.look, look, volume)?;
        if let (Some(_), [only]) = (look.time, &*members)
            && DataKind::of(&only.path)? != DataKind::Run
        {
            if self.scene.is_none() || self.time.is_some() {
                return Err(format!("{}: time: found one moment alone, expected a run", only.path.display()).into());
            }
            // What a scene says is for data like that which it was saved with.
            look.time = None;
        }
        for member in members.iter_mut() {
            let own = families.clone().or_else(|| member.families.take());
            member.families = own.or_else(|| look.families.clone());
        }
        let shot = base.then(Shot {
            camera: camera.then(self.camera),
            size: self.size.or(size),
            stereo,
            labels: catalogue,
            ..Shot::default()
        });
        let mut shot = Shot { look, surround: projection.unwrap_or(shot.surround), ..shot };
        let is_run = |member: &Member| matches!(DataKind::of(&member.path), Ok(DataKind::Run));
        if shot.look.time.is_none() && shot.is_of_tails() && members.iter().any(is_run) {
            // At the first step no path has come from anywhere.
            shot.look.time = Some(When::Last);
        }
        let budget = residency.budget_mib.map(|mebibytes| mebibytes << 20);
        let options = SessionOptions {
            named: members.first().map(|member| member.path.clone()).unwrap_or_default(),
            family: self.family.or(family),
            backend: Some(Backend::Cpu),
            exact: self.exact.then_some(Method::Pyramid),
            memory: self.memory,
            page_memory: Some(self.memory.or(budget).unwrap_or_else(default_memory)),
            chunk_memory: self.memory.or(budget),
            // A picture of several views, or among other data, has no numbers.
            raw: !shot.is_projected() && matches!(&*members, [only] if only.is_in_place() && only.is_of_heights()),
            ..SessionOptions::default()
        };
        Ok((shot, options))
    }

    /// Gives a shot the colours that are asked for in place of those of its transfer function, or of the usual one of what the session draws.
    ///
    /// # Errors
    /// When the look does not fit the data.
    pub fn recolor(&self, session: &mut AnySession, shot: &mut Shot) -> Result<(), PictureError> {
        if self.color_map.is_none() && self.color_scale.is_none() {
            return Ok(());
        }
        let mut transfer = session.transfer(shot)?;
        let (colors, scale) = match &mut transfer.hue {
            Some(hue) => (&mut hue.color_map, &mut hue.scale),
            None => (&mut transfer.color_map, &mut transfer.scale),
        };
        if let Some(asked) = &self.color_map {
            colors.clone_from(asked);
        }
        if let Some(asked) = self.color_scale {
            *scale = asked;
        }
        shot.look.transfer = Some(transfer);
        Ok(())
    }

    fn check(&self) -> Result<(), Failure> {
        if let Some((width, height)) = self.size
            && ![width, height].iter().all(|side| (1..=LARGEST).contains(side))
        {
            return Err(format!("size: found {width} x {height}, expected 1 to {LARGEST} pixels").into());
        }
        let positive =
            [("error_px", self.error_px), ("camera: fov", self.camera.fov), ("camera: ortho", self.camera.ortho)];
        for (name, value) in positive {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(format!("{name}: found {value}, expected a number greater than 0").into());
            }
        }
        Ok(())
    }

    /// The look, over that of the configuration, which says `volume` of what volumes emit and absorb, and over a scene's.
    fn look(
        &self,
        base: &LookPatch,
        mut look: LookPatch,
        volume: Option<TransferFunction>,
    ) -> Result<LookPatch, Failure> {
        let find = |name: &String| {
            let expected = || format!("mode: found {name}, expected one of {}", modes::names());
            modes::find(name).ok_or_else(expected)
        };
        let named = self.mode.as_ref().map(find).transpose()?;
        if named.or(look.mode).or(base.mode).is_some_and(|mode| mode.is_light() && !mode.takes_surfaces()) {
            look.transfer = volume;
        }
        if let Some(mode) = named {
            // A configuration's settings are those of its mode.
            (look.mode, look.settings) = (named, look.settings.of_mode(mode));
        }
        let transfer = self.transfer.as_ref().map(|said| match said.trim_start().starts_with('(') {
            true => TransferFunction::parse(said, "transfer"),
            false => TransferFunction::named(said, presets::folder().as_deref()),
        });
        let mut look = base.then(&look).then(&LookPatch {
            attribute: self.attribute.clone().map(Attribute::Named),
            transfer: transfer.transpose()?,
            error_px: self.error_px,
            background: self.background,
            time: self.time.as_deref().map(str::parse::<When>).transpose()?,
            ..LookPatch::default()
        });
        for (name, value) in &self.settings {
            let setting = setting(look.mode, name, value)?;
            let values = if lod_budget::is_common(name) { &mut look.budget } else { &mut look.settings };
            values.set(setting, value.clone());
        }
        Ok(look)
    }
}

/// The setting of that name that takes this value: the mode's, or where none is named that of any mode.
fn setting(mode: Option<&'static Mode>, name: &str, value: &SettingValue) -> Result<&'static Setting, Failure> {
    let possible = mode.map_or_else(modes::all, |mode| vec![mode]);
    let known: Vec<&'static Setting> = possible.iter().flat_map(|mode| mode.all_settings()).collect();
    let named: Vec<&'static Setting> = known.iter().copied().filter(|setting| setting.name == name).collect();
    let Some(first) = named.first() else {
        let mut names: Vec<&str> = known.iter().map(|setting| setting.name).collect();
        names.sort_unstable();
        names.dedup();
        let whose = mode.map_or("no mode", |mode| mode.name);
        let has = if mode.is_some() { "has no setting" } else { "has a setting" };
        return Err(format!("{whose} {has} {name}, expected {}", names.join(", ")).into());
    };
    if let Some(takes) = named.iter().copied().find(|setting| setting.check(value).is_ok()) {
        return Ok(takes);
    }
    first.check(value)?;
    Ok(*first)
}
