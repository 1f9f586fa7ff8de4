//! An adapter that finds what is seen of heights among other data.

use super::*;
use crate::cpu::surface::picture::{SurfaceOptions, visible};
use crate::cpu::surface::raster::{NO_NUMBER, Shown};
use crate::cpu::volume::{VolumeError, VolumeReport};
use crate::picture::adapter::{AdapterFrame, AdapterSurface, AdapterValues};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A card that finds what the processor finds, as often as it is good for; it counts how often it is asked.
struct Finding {
    asked: Arc<AtomicUsize>,
    most: usize,
}

impl Adapter for Finding {
    fn is_card(&mut self) -> bool {
        true
    }

    fn surface_seen(
        &mut self,
        job: Arc<AdapterSurface>,
        is_colored: bool,
    ) -> Result<(AdapterFrame, Vec<u32>), VolumeError> {
        assert!(!is_colored);
        if self.asked.fetch_add(1, Ordering::Relaxed) >= self.most {
            return Err(VolumeError::Device("a card that is lost".into()));
        }
        let options = SurfaceOptions { technique: job.technique, point: job.point, ..SurfaceOptions::default() };
        let (seen, _) = visible(&job.scene, &Sight::Flat(job.view), &options, job.parts);
        let numbers = (0..seen.width * seen.height).map(|index| seen.at(index).map_or(NO_NUMBER, Shown::pack));
        let frame = AdapterFrame {
            values: AdapterValues::Light(Colors::default(), VolumeReport::default()),
            splats: None,
            backend: "compute",
            adapter: String::new(),
            milliseconds: Default::default(),
            covered: None,
            note: None,
        };
        Ok((frame, numbers.collect()))
    }
}

#[test]
fn what_an_adapter_finds_is_put_together_as_what_the_processor_finds() {
    let folder = tempfile::tempdir().unwrap();
    let ground = field(folder.path(), "ground.asc", [41, 41], [-2.0, -2.0], 0.1, |x, y| {
        // Not everywhere measured.
        if x.hypot(y - 0.5) < 0.4 { -9999.0 } else { 0.3 * (3.0 * x).sin() * (2.0 * y).cos() }
    });
    let cloud = particles(folder.path(), "cloud.df", &cloud(), "m", None);
    let members = [Member::new(&ground), Member::new(cloud)];
    let mut alone = open(&members, "m", SessionOptions::default());
    let dome = Surround::Dome { aperture: 180.0, tilt: -30.0 };
    let cases = [
        (None, Surround::Flat, "{\"walls\": true}"),
        (Some("column-density"), Surround::Flat, "{}"),
        (Some("volume"), Surround::Flat, "{\"holes\": \"filled\"}"),
        (Some("points"), dome, "{}"),
    ];
    let expected = cases.map(|(mode, surround, settings)| {
        let shot = Shot { surround, size: Some((96, 72)), ..shot(mode, settings, [1.0, -3.0, 1.5], None) };
        let picture = alone.draw(&shot).unwrap();
        (picture.image(&shot).unwrap(), picture.surface.unwrap().report, shot)
    });
    let asked = Arc::new(AtomicUsize::new(0));
    // One that fails in the middle is asked no more.
    for most in [usize::MAX, 2] {
        let mut session = open(&members, "m", SessionOptions::default());
        asked.store(0, Ordering::Relaxed);
        session.use_adapter(Some(Box::new(Finding { asked: Arc::clone(&asked), most })));
        for (image, report, shot) in &expected {
            let (before, mode) = (asked.load(Ordering::Relaxed), shot.look.mode.map(|mode| mode.name));
            let picture = session.draw(shot).unwrap();
            assert!(picture.image(shot).unwrap() == *image, "{mode:?}, {most}");
            let found = picture.surface.unwrap().report;
            assert_eq!((found.nodes_drawn, found.covered), (report.nodes_drawn, report.covered), "{mode:?}, {most}");
            let is_asked = asked.load(Ordering::Relaxed) > before;
            assert_eq!(is_asked, before <= most, "{mode:?}, {most}: {before}");
        }
    }
    // The processor where it is asked for, casts rays, and draws several fields.
    let fields = [Member::new(&ground), Member { offset: DVec3::Z, ..Member::new(&ground) }];
    let cpu = SessionOptions { backend: Some(Backend::Cpu), ..SessionOptions::default() };
    let rays = "{\"technique\": \"rays\"}";
    for (members, options, settings) in
        [(&members, cpu, "{}"), (&members, SessionOptions::default(), rays), (&fields, SessionOptions::default(), "{}")]
    {
        let mut session = open(members, "m", options);
        asked.store(0, Ordering::Relaxed);
        session.use_adapter(Some(Box::new(Finding { asked: Arc::clone(&asked), most: 0 })));
        session.draw(&Shot { size: Some((24, 18)), ..shot(None, settings, [1.0, -3.0, 1.5], None) }).unwrap();
        assert_eq!(asked.load(Ordering::Relaxed), 0, "{settings}");
    }
}
