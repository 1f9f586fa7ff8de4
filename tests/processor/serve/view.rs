//! Pictures for browsers: the same as files have, for so many visitors, none of whom gets at anything else.

use super::client::{Answer, asked, connected, serving};
use crate::support::golden::picture_at;
use crate::support::{built_from_dataset, eclipse, run, text};
use deepfield::codec::VqBits;
use deepfield::serve::view::{ViewOptions, Viewing};
use deepfield::serve::{Offer, Running, ServeOptions};
use deepfield::store::Tree;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::Write;
use std::sync::Arc;
use tempfile::TempDir;

/// A server that shows a file of a folder to two visitors.
struct House {
    server: Running,
    viewing: Arc<Viewing>,
    folder: TempDir,
}

/// One that shows a small dataset with a scene.
fn house() -> House {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = eclipse();
    for family in &mut dataset.families {
        family.positions.truncate(6000);
        for column in [&mut family.mass, &mut family.smoothing_length, &mut family.density] {
            column.truncate(6000);
        }
    }
    let built = built_from_dataset(dataset, VqBits::Eight);
    std::fs::copy(built.file.path(), folder.path().join("built.df")).unwrap();
    let text = "(version: 1, datasets: [(path: \"built.df\")], mode: \"column-density\", camera: Some((eye: (0.1, 0.2, 4.0), target: (0.0, 0.0, 0.0))), \
                bookmarks: [(key: 1, name: \"near\", camera: (eye: (0.0, 0.0, 2.0), target: (0.0, 0.0, 0.0)))])";
    std::fs::write(folder.path().join("a.scene.ron"), text).unwrap();
    House::of(folder, "built.df", Some("a.scene.ron"), None)
}

impl House {
    fn of(folder: TempDir, data: &str, scene: Option<&str>, tour: Option<&str>) -> House {
        let place = |name: &str| folder.path().join(name);
        let (path, scene, tour) = (place(data), scene.map(place), tour.map(place));
        let viewing =
            Arc::new(Viewing::open(&ViewOptions { path, scene, tour, visitors: 2, memory: 1 << 30 }).unwrap());
        let server = serving(ServeOptions::default(), Offer::View(Arc::clone(&viewing)));
        House { server, viewing, folder }
    }

    fn get(&self, path: &str, cookie: &str) -> Answer {
        asked(self.server.address(), &format!("GET {path}"), &[&format!("Cookie: deepfield-visitor={cookie}")], b"")
    }

    fn post(&self, path: &str, cookie: &str, request: &Value) -> Answer {
        let cookie = format!("Cookie: deepfield-visitor={cookie}");
        let headers = ["Content-Type: application/json", &cookie];
        asked(self.server.address(), &format!("POST {path}"), &headers, request.to_string().as_bytes())
    }
}

/// A visitor that nobody else is.
fn visitor(number: u8) -> String {
    format!("{number:032x}")
}

fn why(answer: &Answer) -> String {
    let said: Value = serde_json::from_slice(&answer.body).unwrap();
    said["error"].as_str().unwrap().to_owned()
}

#[test]
fn visitors_get_the_pictures_that_files_have() {
    let house = house();
    let page = asked(house.server.address(), "GET /", &[], b"");
    assert!(page.status == 200 && page.text().contains("built.df") && house.viewing.visitors() == 0, "{page:?}");
    assert!(page.header("content-security-policy").contains("script-src 'self';"));
    let own = page.cookie("deepfield-visitor").unwrap().to_owned();
    for (path, has) in
        [("/view/page.js", "import widget"), ("/view/widget.js", "export default"), ("/view/page.css", "body")]
    {
        assert!(house.get(path, &own).text().contains(has), "{path}");
    }
    let about: Value = serde_json::from_slice(&house.get("/view/about", &own).body).unwrap();
    assert_eq!(
        (&about["kind"], &about["mode"], &about["tour"]),
        (&json!("particles"), &json!("column-density"), &Value::Null)
    );
    assert_eq!((&about["bookmarks"][0]["name"], &about["camera"]["eye"]), (&json!("near"), &json!([0.1, 0.2, 4.0])));

    let asked = json!({ "size": [90, 60], "camera": { "target": [0.1, 0.0, 0.0] } });
    let frame = house.post("/view/frame", &own, &asked);
    assert_eq!((frame.status, frame.header("content-type")), (200, "image/png"), "{}", frame.text());
    let facts: Value = serde_json::from_str(frame.header("x-deepfield-facts")).unwrap();
    assert_eq!((&facts["mode"], &facts["converged"]), (&json!("column-density"), &json!(true)));
    let [browser, file] = ["browser.png", "file.png"].map(|name| house.folder.path().join(name));
    std::fs::write(&browser, &frame.body).unwrap();
    let arguments =
        ["render", "built.df", "-o", "file.png", "--size", "90x60", "--mode", "column-density", "--backend", "cpu"];
    let camera = ["--eye", "0.1,0.2,4", "--target", "0.1,0,0"];
    let rendered = run(house.folder.path(), &[&arguments[..], &camera[..]].concat());
    assert!(rendered.status.success(), "{}", String::from_utf8_lossy(&rendered.stderr));
    assert!(picture_at(&browser) == picture_at(&file));

    let pick = json!({ "at": [0.5, 0.5], "place": [0.0, 0.0, 1.0], "radius": 0.2 });
    let picked: Value = serde_json::from_slice(&house.post("/view/pick", &own, &pick).body).unwrap();
    assert!(
        picked["values"]["P"].as_f64().unwrap() > 0.0 && picked["probe"]["count"].as_u64().unwrap() > 0,
        "{picked}"
    );
    let grey =
        house.post("/view/frame", &own, &json!({ "size": [90, 60], "color_map": "grey", "color_scale": "linear" }));
    assert_eq!(grey.status, 200, "{}", grey.text());
    std::fs::write(&browser, &grey.body).unwrap();
    assert!(picture_at(&browser).rgba.iter().all(|[red, _, blue, _]| red.abs_diff(*blue) <= 2));
    let coarse = house.post("/view/frame", &own, &json!({ "size": [90, 60], "format": "jpeg", "colors": "grey" }));
    assert_eq!((coarse.header("content-type"), &coarse.body[..2]), ("image/jpeg", &[0xff, 0xd8][..]));
}

#[test]
fn visitors_get_the_times_and_the_tours_that_files_have() {
    let folder = tempfile::tempdir().unwrap();
    text(folder.path(), &["synth", "orbits", "-n", "2000", "--steps", "3", "-o", "run"]);
    text(folder.path(), &["build", "run_000", "run_001", "run_002", "-o", "run.df"]);
    // Four frames a second.
    let tour = "(version: 2, rate: 4.0, keyframes: [(mode: \"column-density\"), \
                (after: 1.0, orbit: 40.0, time: last, caption: \"turned\")])";
    std::fs::write(folder.path().join("a.tour.ron"), tour).unwrap();
    let house = House::of(folder, "run.df", None, Some("a.tour.ron"));
    let own = visitor(1);
    let about: Value = serde_json::from_slice(&house.get("/view/about", &own).body).unwrap();
    assert_eq!((&about["kind"], &about["tour"], &about["time"]), (&json!("run"), &json!(1.0), &json!(0.0)));
    assert_eq!(about["steps"].as_array().map(Vec::len), Some(3));

    let of_time = |time: f64| json!({ "size": [64, 48], "mode": "column-density", "time": time });
    let of_tour = |seconds: f64| json!({ "size": [64, 48], "tour": seconds });
    let drawn = ["--size", "64x48", "--backend", "cpu"];
    let mut pictures = BTreeSet::new();
    // From the one to the other and back; what is asked for after a tour's end is its end.
    for (asked, command) in [
        (of_time(0.2), ["render", "run.df", "--time=0.2", "--mode=column-density", "--output=file.png"]),
        (of_tour(0.75), ["tour", "a.tour.ron", "--frame", "3", "file.png"]),
        (of_time(0.7), ["render", "run.df", "--time=0.7", "--mode=column-density", "--output=file.png"]),
        (of_tour(0.25), ["tour", "a.tour.ron", "--frame", "1", "file.png"]),
        (of_tour(99.0), ["tour", "a.tour.ron", "--frame", "4", "file.png"]),
    ] {
        let frame = house.post("/view/frame", &own, &asked);
        assert_eq!(frame.status, 200, "{asked}: {}", frame.text());
        let data: &[&str] = if command[0] == "tour" { &["run.df"] } else { &[] };
        text(house.folder.path(), &[&command[..2], data, &command[2..], &drawn[..]].concat());
        assert!(frame.body == std::fs::read(house.folder.path().join("file.png")).unwrap(), "{asked}");
        assert!(pictures.insert(frame.body), "{asked}: a picture of another moment");
    }
}

#[test]
fn what_no_visitor_may_ask_is_refused_in_words() {
    let house = house();
    let own = visitor(1);
    let refused = [
        (json!({ "size": [4096, 4096] }), 422, "size: found 4096 x 4096"),
        (json!({ "size": [0, 10] }), 422, "size"),
        (json!({ "colors": "/etc/passwd.ron" }), 422, "colors"),
        (json!({ "color_map": "none-such" }), 400, "no colour map `none-such`"),
        (json!({ "mode": "none-such" }), 422, "mode: found none-such"),
        (json!({ "attribute": "none-such" }), 422, "none-such"),
        (json!({ "time": 3.0 }), 422, "time"),
        (json!({ "tour": 1.0 }), 422, "tour: found none"),
        (json!({ "camera": { "eye": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 0.0] } }), 422, ""),
        (json!({ "config": "(transfer: \"/etc/passwd\")" }), 400, "unknown field"),
        (json!([1, "x".repeat(20_000)]), 413, "at most"),
    ];
    for (request, status, words) in refused {
        let answer = house.post("/view/frame", &own, &request);
        let why = why(&answer);
        assert!(answer.status == status && why.contains(words), "{request}: {} {why}", answer.status);
        assert!(!why.contains(&*house.folder.path().to_string_lossy()) && !why.contains("/built.df"), "{why}");
    }
    let form = asked(house.server.address(), "POST /view/frame", &["Content-Type: text/plain"], b"{}");
    assert_eq!(
        (form.status, house.get("/view/frame", &own).status, house.get("/built.df", &own).status),
        (415, 405, 404)
    );
    // The next picture is drawn as if nothing had been.
    assert_eq!(house.post("/view/frame", &own, &json!({ "size": [30, 20] })).status, 200);
}

#[test]
fn a_full_house_says_so_and_who_leaves_makes_room() {
    let house = house();
    let small = json!({ "size": [30, 20] });
    let [first, second, third] = [1, 2, 3].map(visitor);
    assert_eq!([&first, &second].map(|own| house.post("/view/frame", own, &small).status), [200; 2]);
    assert_eq!(house.viewing.visitors(), 2);
    let page = house.get("/", &third);
    assert!(page.status == 503 && page.text().contains("All places are taken") && page.header("retry-after") == "30");
    let frame = house.post("/view/frame", &third, &small);
    assert_eq!((frame.status, why(&frame)), (503, "all 2 places are taken: the page tries again by itself".to_owned()));
    // Those who are in stay in.
    assert_eq!((house.get("/", &first).status, house.post("/view/frame", &second, &small).status), (200, 200));
    assert_eq!(house.post("/view/leave", &first, &json!({})).status, 200);
    assert_eq!((house.post("/view/frame", &third, &small).status, house.get("/view/about", &first).status), (200, 503));
}

#[test]
fn the_newest_is_drawn_and_who_hangs_up_is_forgotten() {
    let house = house();
    let (own, address) = (visitor(1), house.server.address());
    let large = json!({ "size": [1400, 1000] }).to_string();
    let hang_up = || {
        let mut stream = connected(address);
        let head = format!(
            "POST /view/frame HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nCookie: deepfield-visitor={own}\r\n\
             Content-Length: {}\r\n\r\n{large}",
            large.len()
        );
        stream.write_all(head.as_bytes()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
    };
    for _ in 0..4 {
        hang_up();
    }
    let small = json!({ "size": [30, 20] });
    assert_eq!(house.post("/view/frame", &own, &small).status, 200);
    assert_eq!(house.viewing.visitors(), 1);
    // Several pages of one visitor: each gets an answer, and one of them the picture.
    let statuses: Vec<u16> = std::thread::scope(|scope| {
        let pages: Vec<_> = (0..6).map(|_| scope.spawn(|| house.post("/view/frame", &own, &small).status)).collect();
        pages.into_iter().map(|page| page.join().unwrap()).collect()
    });
    assert!(statuses.contains(&200) && statuses.iter().all(|status| matches!(status, 200 | 409)), "{statuses:?}");
    // A picture that has been taken is in the way of no other.
    assert!((0..6).all(|_| house.post("/view/frame", &own, &small).status == 200));
    // Who leaves in the middle of a picture finds the place again.
    hang_up();
    assert_eq!(house.post("/view/leave", &own, &json!({})).status, 200);
    assert_eq!((house.post("/view/frame", &own, &small).status, house.viewing.visitors()), (200, 1));
}
