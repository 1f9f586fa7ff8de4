//! Layouts of any view keep their promises.
#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::color::transfer::TransferFunction;
use crate::view::Projection;
use proptest::prelude::*;
use std::sync::Arc;

fn legend(hue: bool, range: [f64; 2]) -> Legend {
    let axis =
        |title: &str, unit: &str| LegendAxis { title: title.into(), unit: unit.into(), range, log: true, whole: false };
    let preset = if hue { "density-hue" } else { "density" };
    Legend {
        p: axis("Integral of squared density", "(1e10 Msun/h)² / (kpc/h)⁵"),
        s: hue.then(|| axis("Velocity dispersion", "km/s")),
        lut: Arc::new(TransferFunction::preset(preset).unwrap().bake_lut()),
        opacity: if hue { Vec::new() } else { vec![0.0, 0.1, 0.7] },
        arrow: KeyArrow::of(range[1], 30.0, &crate::model::Unit::new("km/s")),
    }
}

fn words(list: &DisplayList) -> Vec<display_list::Area> {
    list.shapes.iter().filter(|shape| matches!(shape, Shape::Text { .. })).map(Shape::area).collect()
}

proptest! {
    #![proptest_config(crate::cases::cases(64))]
    #[test]
    fn words_keep_apart_and_in_the_picture(
        eye in [-3.0..3.0f64, -3.0..3.0, -3.0..3.0],
        (width, height) in (420u32..2000, 300u32..1500),
        ortho in any::<bool>(), hue in any::<bool>(),
        decades in 0.1..9.0f64,
        objects in proptest::collection::vec(([-1.0..1.0f64, -1.0..1.0, -1.0..1.0], 0.0..0.3f64), 0..60),
    ) {
        let eye = DVec3::from(eye);
        prop_assume!(eye.length() > 0.1 && eye.cross(DVec3::Y).length() > 0.05);
        let projection =
            if ortho { Projection::Orthographic { height: 3.0 } } else { Projection::Perspective { fov_y: 0.8 } };
        let view = View::look_at(eye, DVec3::ZERO, DVec3::Y, projection, width, height).unwrap();
        let labels: Vec<Label> = objects
            .iter()
            .enumerate()
            .map(|(i, (at, radius))| Label { name: format!("Object {i}"), position: DVec3::from(*at), radius: Some(*radius) })
            .collect();
        let legend = legend(hue, [1e-3, 1e-3 * 10f64.powf(decades)]);
        let annotations = Annotations {
            axes: true, triad: true, clock: true, caption: "A caption".into(), scale: Some(1.0), ..Annotations::default()
        };
        let subject = Subject {
            view: &view, scale: 1.0, target: DVec3::ZERO,
            bounds: Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) },
            length_unit: "kpc/h", time: "z = 1.5, a = 0.4", legend: Some(&legend), labels: &labels,
        };
        let list = layout(&annotations, &subject);
        let words = words(&list);
        prop_assert!(words.len() > 4);
        let page = list.page().grown(0.1);
        for (i, area) in words.iter().enumerate() {
            prop_assert!(page.holds(area), "{area:?} leaves {page:?}");
            for other in &words[..i] {
                prop_assert!(!other.grown(-0.6).overlaps(&area.grown(-0.6)), "{other:?} and {area:?}");
            }
        }
        // The first of the names has the first choice: if any is written, none before it was without a reason.
        let written = list.shapes.iter().filter(|s| matches!(s, Shape::Text { text, .. } if text.starts_with("Object"))).count();
        prop_assert!(written <= annotations.labels);
        for shape in &list.shapes {
            let area = shape.area();
            prop_assert!(area.min.iter().chain(&area.max).all(|x| x.is_finite()));
        }
    }
}

#[test]
fn the_more_important_name_wins_and_far_ones_fade() {
    let projection = Projection::Perspective { fov_y: 0.8 };
    let view = View::look_at(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y, projection, 800, 600).unwrap();
    let label = |name: &str, position: DVec3| Label { name: name.into(), position, radius: None };
    // So many about one place that not all names find room around it, and one that is the same thing as the first.
    let beside = |i: usize| DVec3::new(0.01, 0.09, 0.0) * i as f64;
    let mut labels: Vec<Label> = (0..8).map(|i| label(&format!("near {i}"), beside(i))).collect();
    labels.insert(1, label("same", DVec3::splat(0.001)));
    labels.push(label("far", DVec3::new(2.0, 0.0, -30.0)));
    labels.push(label("too far", DVec3::new(9.0, 0.0, -200.0)));
    labels.push(label("behind", DVec3::Z * 20.0));
    let subject = Subject {
        view: &view,
        scale: 1.0,
        target: DVec3::ZERO,
        bounds: Bounds::EMPTY,
        length_unit: "",
        time: "",
        legend: None,
        labels: &labels,
    };
    let list = layout(&Annotations { scale_bar: false, ..Annotations::default() }, &subject);
    let mut alphas = std::collections::BTreeMap::new();
    for shape in &list.shapes {
        if let Shape::Text { text, color, .. } = shape {
            alphas.insert(text.clone(), color[3]);
        }
    }
    assert_eq!(alphas.get("near 0"), Some(&255));
    assert!(alphas.contains_key("near 1") && !alphas.contains_key("near 7"), "{alphas:?}");
    assert!(!alphas.contains_key("same"), "{alphas:?}");
    assert!((1..255).contains(&alphas["far"]), "{alphas:?}");
    assert!(!alphas.contains_key("too far") && !alphas.contains_key("behind"));
}

#[test]
fn settings_are_refused_with_their_name() {
    let message = |text: &str| crate::model::ron_file::parse::<Annotations>("a.ron", text).unwrap_err().to_string();
    for field in ["legend", "scale_bar", "axes", "triad", "labels", "caption", "scale"] {
        let text = format!("({field}x: true)");
        assert!(message(&text).contains(&format!("{field}x")), "{text}");
    }
    assert!(message("(scale: 0.0)").contains("scale is 0, expected a number from 0.25 to 16"));
    assert!(Annotations::NONE.with("legends").unwrap_err().contains("legend, scale-bar"));
    for part in Annotations::PARTS {
        assert_ne!(Annotations::NONE.with(part).unwrap(), Annotations::NONE);
    }
    let all = Annotations { axes: true, caption: "\"z\" = 0".into(), scale: Some(2.0), ..Annotations::default() };
    let text = ron::to_string(&all).unwrap();
    assert_eq!(crate::model::ron_file::parse::<Annotations>("a.ron", &text).unwrap(), all);
}

#[test]
fn names_are_at_the_images_that_are_drawn() {
    let projection = Projection::Orthographic { height: 60.0 };
    let target = DVec3::new(2.0, 25.0, 25.0);
    let view = View::look_at(target + DVec3::Z * 100.0, target, DVec3::Y, projection, 800, 600).unwrap();
    let of = crate::model::PeriodicBox { edge: 50.0, bounds: Bounds { min: DVec3::ZERO, max: DVec3::splat(50.0) } };
    let cut = crate::view::CutSettings { periodic: crate::view::Periodic::Wrapped, ..Default::default() };
    let wrapped = cut.applied(&view, target, Some(of));
    let labels = [Label { name: "across".into(), position: DVec3::new(48.0, 25.0, 25.0), radius: Some(1.0) }];
    let circle = |view: &View| {
        let subject = Subject {
            view,
            scale: 1.0,
            target,
            bounds: of.bounds,
            length_unit: "",
            time: "",
            legend: None,
            labels: &labels,
        };
        let list = layout(&Annotations { scale_bar: false, ..Annotations::default() }, &subject);
        list.shapes.iter().find_map(|shape| match shape {
            Shape::Circle { center, .. } => Some(center[0]),
            _ => None,
        })
    };
    // Pixels are a tenth of a unit: 4 units to the left of the middle instead of 46 to the right, outside.
    assert!((circle(&wrapped).unwrap() - 360.0).abs() < 1e-3, "{:?}", circle(&wrapped));
    assert_eq!(circle(&view), None);
}
