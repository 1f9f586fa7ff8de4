//! `bench compare` by an adapter's passes: the techniques come to the processor's pictures.

use crate::support::run;
use deepfield::annotate::overlay::read_png;
use deepfield::color::composite::color_error;
use serde_json::Value;

/// Largest mean colour error of an adapter's picture against the processor's, and difference of their errors against the references, of
/// 255: less than the rounding of one colour to bytes.
const TOLERANCE: f64 = 0.5;

#[test]
fn a_comparison_by_passes_is_that_of_the_processor() {
    let folder = tempfile::tempdir().unwrap();
    let made = run(folder.path(), &["synth", "merger", "-n", "1500", "-o", "merger"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let compare = |backend: &str| -> Value {
        let view = ["bench", "compare", "merger", "--size", "60x40", "--eye", "60,120,225", "--target", "0,0,0"];
        let grid = ["--repeat", "1", "--layers", "64", "--cells", "48", "--frames", "0", "--json", "-"];
        let output = run(folder.path(), &[&view[..], &grid[..], &["--output", backend, "--backend", backend]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (by_passes, by_processor) = (compare("compute"), compare("cpu"));
    assert!(by_passes["adapter"].is_string() && by_processor["adapter"].is_null(), "{by_passes:#}");
    let [drawn, expected] = [&by_passes, &by_processor].map(|report| report["outcomes"].as_array().unwrap());
    assert_eq!(drawn.len(), expected.len());
    for (drawn, expected) in drawn.iter().zip(expected) {
        let name = drawn["name"].as_str().unwrap();
        assert_eq!(name, expected["name"]);
        assert_eq!(expected["backend"], "cpu", "{name}");
        assert_eq!(drawn["backend"], "compute", "{name}");
        assert!(drawn["resampling"].is_null(), "{name}");
        assert!(drawn["total"]["median"].as_f64().unwrap() > 0.0, "{name}");
        let marches = ["volume", "isosurface", "cartesian"].contains(&drawn["mode"].as_str().unwrap());
        assert!(marches || drawn["passes"]["cast"].is_null(), "{name} has the times of another technique: {drawn:#}");
        let file = format!("{}.png", name.replace(", ", "-").replace(' ', "-"));
        let [picture, reference] =
            ["compute", "cpu"].map(|output| read_png(&folder.path().join(output).join(&file)).unwrap());
        let (error, largest) = color_error(&picture, &reference);
        assert!(error < TOLERANCE, "{name}: mean colour error {error}, largest {largest}");
        for kind in ["error_volume", "error_surface"] {
            let [found, wanted] = [drawn, expected].map(|outcome| outcome[kind].as_f64().unwrap());
            assert!((found - wanted).abs() < TOLERANCE, "{name}: {kind} {found}, by the processor {wanted}");
        }
    }
}
