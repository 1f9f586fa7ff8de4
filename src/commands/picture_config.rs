//! The command line over a file of `render --config`.

use super::annotate::AnnotateOptions;
use super::arguments::PictureSize;
use super::render_arguments::Arguments;
use crate::look::PictureConfig;
use crate::mode::Settings;
use glam::DVec3;

/// The arguments, with this configuration where they say nothing.
pub fn complete(config: PictureConfig, arguments: &Arguments) -> Arguments {
    let PictureConfig { look, camera, .. } = config;
    let has_projection = arguments.fov.is_some() || arguments.ortho.is_some();
    let own = arguments.clone();
    Arguments {
        size: own.size.or(config.size.map(|(width, height)| PictureSize { width, height })),
        backend: own.backend.or(config.backend),
        mode: own.mode.or(look.mode),
        family: own.family.or(config.family),
        attribute: own.attribute.or(look.attribute_name().map(str::to_owned)),
        eye: own.eye.or(camera.eye.map(DVec3::from)),
        target: own.target.or(camera.target.map(DVec3::from)),
        up: own.up.or(camera.up.map(DVec3::from)),
        fov: if has_projection { own.fov } else { camera.fov },
        ortho: if has_projection { own.ortho } else { camera.ortho },
        error_px: own.error_px.or(look.error_px),
        settings: {
            // The mode's own settings go with the mode that the file names.
            let mut settings = if own.mode.is_some() { Settings::default() } else { look.settings };
            settings.0.extend(own.settings.0.clone());
            settings
        },
        // One named on the command line is for whatever is drawn.
        budget: look.budget,
        volume: own.transfer.clone().or(config.volume),
        transfer: own.transfer.clone().or(look.transfer),
        annotations: look.annotations,
        annotate: AnnotateOptions { labels: own.annotate.labels.clone().or(config.catalogue), ..own.annotate.clone() },
        background: own.background.or(look.background),
        surround: config.projection,
        stereo_pair: config.stereo,
        cut: look.cut.unwrap_or_default(),
        ..own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_is_read_and_the_command_line_overrides_it() {
        let config = PictureConfig::parse("picture.ron", include_str!("../../configs/picture.ron")).unwrap();
        let mut arguments = Arguments::new("a".into(), "b.png".into());
        arguments.error_px = Some(3.0);
        arguments.fov = Some(20.0);
        let all = complete(config, &arguments);
        assert_eq!(all.mode.map(|mode| mode.name), Some("density-squared"));
        assert_eq!((all.error_px, all.fov, all.ortho), (Some(3.0), Some(20.0), None));
        assert!(all.transfer.is_some());
    }

    #[test]
    fn the_example_of_a_volume_is_read() {
        let config = PictureConfig::parse("volume.ron", include_str!("../../configs/volume.ron")).unwrap();
        let all = complete(config, &Arguments::new("a".into(), "b.png".into()));
        assert!(all.volume.is_some() && all.mode.is_some_and(|mode| mode.painter().is_some()));
    }
}
