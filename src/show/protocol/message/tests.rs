use super::*;
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![-1e12..1e12f64, -1.0..1.0f64, Just(0.0), Just(-0.0), Just(1e-300), Just(f64::MAX / 4.0)]
}

fn camera() -> impl Strategy<Value = Camera> {
    let point = || prop::array::uniform3(-1e9..1e9f64);
    (point(), point(), point(), 1e-3..179.9f64, prop::option::of(1e-9..1e9f64))
        .prop_map(|(eye, target, up, fov, ortho)| Camera { eye, target, up, fov, ortho })
        .prop_filter("sees something", |camera| camera.view(64, 64).is_ok())
}

fn frame() -> impl Strategy<Value = Frame> {
    let range = || prop::array::uniform2(number()).prop_map(|[a, b]| [a.min(b), a.max(b)]);
    let ranges = prop::option::of((range(), range()).prop_map(|(p, s)| Ranges { p, s }));
    let tour = prop::option::of((0.0..1e7f64, any::<bool>()).prop_map(|(time, running)| TourTime { time, running }));
    let run = prop::option::of((number(), any::<bool>()).prop_map(|(time, holds)| RunTime { time, holds }));
    (any::<u64>(), 0.0..1e9f64, camera(), ranges, tour, run)
        .prop_map(|(number, time, camera, ranges, tour, run)| Frame { number, time, camera, ranges, tour, run })
}

fn report() -> impl Strategy<Value = Report> {
    (any::<[u64; 4]>(), 0.0..1e6f64, any::<bool>()).prop_map(
        |([session, frame, missing, failed], frame_ms, converged)| Report {
            session,
            frame,
            frame_ms,
            missing,
            failed,
            converged,
        },
    )
}

fn from_leader() -> impl Strategy<Value = FromLeader> {
    prop_oneof![
        any::<u64>().prop_map(|session| FromLeader::Welcome { session }),
        any::<String>().prop_map(|text| FromLeader::Scene { text }),
        (any::<String>(), any::<String>(), 1e-3..1e3f64).prop_map(|(text, folder, aspect)| FromLeader::Tour {
            text,
            folder,
            aspect
        }),
    ]
}

fn from_follower() -> impl Strategy<Value = FromFollower> {
    let text = |most| "\\PC{1,70}".prop_map(move |text| plain(&text, most));
    prop_oneof![
        (any::<[u64; 2]>(), text(MOST_NAME)).prop_map(|([session, instance], name)| FromFollower::Hello {
            session,
            name,
            instance
        }),
        (any::<u64>(), any::<bool>(), text(MOST_WORDS)).prop_map(|(session, bad, text)| {
            let severity = if bad { Severity::Error } else { Severity::Info };
            FromFollower::Told { session, severity, text }
        }),
    ]
}

/// Everything comes back bit for bit.
fn comes_back<T: Message + PartialEq + std::fmt::Debug>(message: &T) {
    let bytes = message.encode().unwrap();
    let back = T::decode(&bytes).unwrap();
    assert_eq!(&back, message);
    assert_eq!(back.encode().unwrap(), bytes, "signs of zeros, too");
}

fn decode_all(bytes: &[u8]) {
    let _ = Frame::decode(bytes);
    let _ = Report::decode(bytes);
    let _ = FromLeader::decode(bytes);
    let _ = FromFollower::decode(bytes);
}

proptest! {
    #[test]
    fn messages_come_back(frame in frame(), report in report(), leader in from_leader(), follower in from_follower()) {
        comes_back(&frame);
        comes_back(&report);
        comes_back(&leader);
        comes_back(&follower);
    }

    /// Bytes of any kind are refused or understood, and what is understood passes every check.
    #[test]
    fn damaged_messages_are_refused_or_sound(
        frame in frame(),
        leader in from_leader(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
    ) {
        for mut bytes in [frame.encode().unwrap(), leader.encode().unwrap()] {
            for (at, value) in &damage {
                let at = at.index(bytes.len());
                bytes[at] = *value;
            }
            decode_all(&bytes);
            decode_all(&bytes[..cut.index(bytes.len())]);
            if let Ok(frame) = Frame::decode(&bytes) {
                prop_assert!(frame.camera.view(64, 64).is_ok() && frame.time.is_finite());
            }
        }
    }

    #[test]
    fn random_bytes_are_refused(mut bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        decode_all(&bytes);
        if let Some(first) = bytes.first_mut() {
            *first = VERSION;
        }
        decode_all(&bytes);
        prop_assert!(Frame::decode(&bytes).is_err());
    }
}

#[test]
fn what_makes_no_sense_is_refused_with_its_field() {
    let camera = Camera { eye: [0.0, 0.0, 9.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 40.0, ortho: None };
    let good = Frame { number: 1, time: 0.5, camera, ranges: None, tour: None, run: None };
    comes_back(&good);
    let wrong: [(&str, fn(&mut Frame)); 8] = [
        ("time", |frame| frame.time = f64::NAN),
        ("camera", |frame| frame.camera.eye[1] = f64::INFINITY),
        ("camera", |frame| frame.camera.eye = frame.camera.target),
        ("camera.fov", |frame| frame.camera.fov = 180.0),
        ("camera", |frame| frame.camera.ortho = Some(-1.0)),
        ("ranges.s", |frame| frame.ranges = Some(Ranges { p: [0.0, 1.0], s: [2.0, 1.0] })),
        ("ranges.p", |frame| frame.ranges = Some(Ranges { p: [0.0, f64::NAN], s: [0.0, 1.0] })),
        ("tour.time", |frame| frame.tour = Some(TourTime { time: -1.0, running: true })),
    ];
    for (field, change) in wrong {
        let mut frame = good;
        change(&mut frame);
        let told = Frame::decode(&frame.encode().unwrap()).unwrap_err().to_string();
        assert!(told.contains(&format!("frame: {field} is")), "{told}");
    }
    for text in ["a\nb", "\u{1b}[2J", ""] {
        let hello = FromFollower::Hello { session: 1, name: text.to_owned(), instance: 2 };
        assert!(FromFollower::decode(&hello.encode().unwrap()).is_err(), "{text:?}");
    }
    let mut later = good.encode().unwrap();
    later[0] = VERSION + 1;
    assert!(Frame::decode(&later).unwrap_err().to_string().contains("the same deepfield"));
}

#[test]
fn deep_and_long_texts_are_refused() {
    let deep = |open: &str| [&[VERSION][..], open.repeat(400).as_bytes()].concat();
    for open in ["(", "[", "{", "Some(", "\""] {
        decode_all(&deep(open));
        assert!(Frame::decode(&deep(open)).is_err());
    }
    assert!(matches!(Frame::decode(&vec![b' '; 5000]), Err(MessageError::Length { .. })));
    assert!((FromLeader::Scene { text: "x".repeat(2 * MOST_TEXT) }).encode().is_none());
    let long = FromLeader::Scene { text: "x".repeat(MOST_TEXT + 1) };
    assert!(FromLeader::decode(&long.encode().unwrap()).is_err());
}
