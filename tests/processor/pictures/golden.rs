//! Golden images, one for each mode: the whole way from the demo snapshot to colours; and of what settings add to modes, by the program.
//! `DEEPFIELD_BLESS=1` writes them anew; look at them before committing.

use crate::support::golden::{TOLERANCE, check, difference, golden, picture_at};
use crate::support::{built, demo, draw_pages, draw_source, ok, paint_pages, view_of};
use deepfield::annotate::{self, Annotations, Label, Legend, Subject, Units};
use deepfield::codec::VqBits;
use deepfield::color::Accumulation;
use deepfield::color::composite::{Image, composite, composite_at};
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::Method;
use deepfield::mode::{Depiction, Settings};
use deepfield::model::{Dataset, Kernel};
use deepfield::modes;
use glam::DVec3;
use std::sync::Arc;

fn colors(mode: &str, picture: &Accumulation) -> Image {
    let preset = modes::find(mode).unwrap().transfer[usize::from(picture.has_attribute())];
    composite(picture, &TransferFunction::preset(preset).unwrap())
}

#[test]
fn every_mode_draws_its_golden_image() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 240, 160);
    for mode in modes::all().into_iter().filter(|mode| mode.takes_particles() && !mode.is_of_paths()) {
        match mode.is_light() {
            false => check(mode.name, &colors(mode.name, &draw_pages(&built.file, mode.name, &view, 0.8))),
            true => check(mode.name, &paint_pages(&built.file, mode.name, &view, 0.8)),
        }
    }
}

#[test]
fn an_annotated_picture_is_its_golden_image() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.6, 0.4, 1.0), 1.9, 640, 440);
    let metadata = built.file.metadata();
    let depiction =
        Depiction::new(modes::find("density-squared").unwrap(), Settings::default(), None, metadata).unwrap();
    let picture = draw_pages(&built.file, "density-squared", &view, 0.8);
    let transfer = TransferFunction::preset("density-hue").unwrap();
    let levels = transfer.levels(&picture);
    let mut image = composite_at(&picture, &transfer, &levels);
    let lut = Arc::new(transfer.bake_lut());
    let legend = Legend::of(&depiction, &transfer, lut, &levels, &Units::of(metadata, &depiction));
    let bounds = metadata.bounds();
    let label = |name: &str, at: [f64; 3], radius: f64| Label {
        name: name.into(),
        position: bounds.min + DVec3::from_array(at) * bounds.size(),
        radius: Some(radius * bounds.size().x),
    };
    let labels = [label("Group 0", [0.5, 0.5, 0.5], 0.06), label("Group 1", [0.3, 0.8, 0.6], 0.03)];
    let subject = Subject {
        view: &view,
        scale: 1.0,
        target: bounds.center(),
        bounds,
        length_unit: &metadata.length_unit.to_string(),
        legend: Some(&legend),
        labels: &labels,
        time: "",
    };
    let all = Annotations { axes: true, triad: true, caption: "A box of dark matter".into(), ..Annotations::default() };
    annotate::paint(&mut image, &annotate::layout(&all, &subject), 1.0, annotate::Paper::Dark);
    check("annotated", &image);
}

#[test]
fn shadows_lit_fields_and_vectors_are_their_golden_images() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ok(folder, &["synth", "merger", "-n", "3000", "-o", "merger"]);
    let attributes = "internal-energy,velocity-x,velocity-y,velocity-z";
    ok(folder, &["build", "merger", "-o", "flow.df", "--attributes", attributes]);
    let drawn = |look: &[&str], settings: &[&str]| -> Image {
        let common = ["render", "flow.df", "-o", "picture.png", "--size", "120x80", "--backend", "cpu"];
        let settings = settings.iter().flat_map(|setting| ["--set", *setting]);
        let arguments: Vec<&str> = common.into_iter().chain(look.iter().copied()).chain(settings).collect();
        ok(folder, &arguments);
        picture_at(&folder.join("picture.png"))
    };
    let dense = "--mode spheres --eye 25,40,60 --set threshold=5e-6 --set sphere-radius=0.3 --set smoothing=0.5";
    let surface = "--mode isosurface --eye 25,40,60 --set isovalues=[5e-6] --set iso-opacities=[1]";
    let shadows = ["ambient-occlusion=0.7", "shadows=0.7", "light-size=8", "shadow-azimuth=-60", "shadow-altitude=15"];
    // Surfaces of density, coloured by velocity, in a volume of energy; what is around it is wide, and takes long.
    let field = "--mode volume-isosurface --eye 30,50,160 --set near=120 --set far=260 \
                 --set field=internal-energy --attribute velocity-y";
    let slice = "--mode cross-section --eye 0,0,500 --ortho 100 --set through=[0,0,0]";
    let heat = format!("{slice} --set field=internal-energy");
    let looks: [(&str, &str, &[&str]); 5] = [
        ("spheres-shadows", dense, &shadows),
        ("isosurface-shadows", surface, &shadows),
        ("volume-isosurface-lit", field, &["volume-lighting=true"]),
        ("cross-section-arrows", slice, &["vectors=arrows"]),
        ("cross-section-streaks", &heat, &["vectors=lic"]),
    ];
    for (name, look, added) in looks {
        let look: Vec<&str> = look.split(' ').chain(["--target", "0,0,0"]).collect();
        check(name, &drawn(&look, added));
        // What the tolerance is worth.
        let found = difference(&drawn(&look, &[]), &golden(&format!("{name}.png")));
        assert!(found > 2.0 * TOLERANCE, "{name}: {added:?} changes only {found:.3}/255");
    }
}

#[test]
fn a_changed_kernel_or_transfer_function_is_seen() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 240, 160);
    let golden = golden("column-density.png");
    let source = Dataset { kernel: Kernel::Poly6, ..built.dataset.clone() };
    let other_kernel = draw_source(&source, "column-density", &view, Method::Pyramid);
    let found = difference(&colors("column-density", &other_kernel), &golden);
    assert!(found > 2.0 * TOLERANCE, "another kernel changes only {found:.3}/255");
    let picture = draw_pages(&built.file, "column-density", &view, 0.8);
    let function = TransferFunction { gamma: 1.05, ..TransferFunction::preset("density").unwrap() };
    let found = difference(&composite(&picture, &function), &golden);
    assert!(found > 2.0 * TOLERANCE, "another transfer function changes only {found:.3}/255");
}
