//! `bench flight` in modes that draw light: an adapter's passes fly through what the processor flies through.

use crate::support::{built, demo, run};
use deepfield::annotate::overlay::read_png;
use deepfield::codec::VqBits;
use deepfield::color::composite::color_error;
use serde_json::Value;

/// Largest mean colour error of an adapter's picture against the processor's, of 255.
const TOLERANCE: f64 = 0.5;

#[test]
fn flights_by_passes_show_what_the_processor_shows() {
    let built = built(&demo(), VqBits::Eight);
    let file = built.file.path().to_str().unwrap();
    for mode in ["volume", "spheres"] {
        let folder = tempfile::tempdir().unwrap();
        let arguments = ["bench", "flight", file, "--backends", "cpu,compute", "--mode", mode, "--duration", "1"];
        let more = ["--velocity", "0.05", "--size", "96x64", "--check", "1", "--json", "-"];
        let output = run(folder.path(), &[&arguments[..], &more[..]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let outcomes: Value = serde_json::from_slice(&output.stdout).unwrap();
        let outcomes = outcomes.as_array().unwrap();
        let backends: Vec<_> = outcomes.iter().map(|outcome| outcome["backend"].as_str().unwrap()).collect();
        assert_eq!(backends, ["cpu", "compute"], "{mode}");
        for outcome in outcomes {
            let check = &outcome["checks"][0];
            assert_eq!(check["converged"], true, "{mode}: {outcome:#}");
            assert!(check["difference"].as_f64().unwrap() < 1e-4, "{mode}: {outcome:#}");
            assert!(outcome["flight"]["frames"].as_u64() > Some(0), "{mode}: {outcome:#}");
        }
        let [expected, found] = ["cpu", "compute"]
            .map(|backend| read_png(&folder.path().join(format!("flight/flight-{backend}-0s-whole.png"))).unwrap());
        let (mean, _) = color_error(&found, &expected);
        println!("{mode}: {mean}");
        assert!(mean < TOLERANCE, "{mode}: {mean}");
        assert!(expected.rgba.iter().any(|pixel| pixel[0].max(pixel[1]).max(pixel[2]) > 60), "{mode}: nothing to see");
    }
}
