//! Round trips of every type, bounds of what is rounded, and bytes that nobody wrote.

use super::*;
use deepfield_data::model::Scale;
use proptest::prelude::*;

const TYPES: [SampleType; 8] = [
    SampleType::I8,
    SampleType::U8,
    SampleType::I16,
    SampleType::U16,
    SampleType::I32,
    SampleType::U32,
    SampleType::F32,
    SampleType::F64,
];

/// A value of a type, from any bits: extremes, too.
fn value(sample_type: SampleType, bits: u64, shift: u32) -> f64 {
    let small = (bits as i64) >> (shift % 64);
    match sample_type {
        SampleType::I8 => f64::from(small as i8),
        SampleType::U8 => f64::from(small as u8),
        SampleType::I16 => f64::from(small as i16),
        SampleType::U16 => f64::from(small as u16),
        SampleType::I32 => f64::from(small as i32),
        SampleType::U32 => f64::from(small as u32),
        SampleType::F32 if shift > 20 => f64::from(small as f32 * 0.001),
        SampleType::F32 => f64::from(f32::from_bits(bits as u32)),
        _ if shift > 20 => small as f64 * 1e-5,
        _ => f64::from_bits(bits),
    }
}

/// Samples of a type in rows of so many; some were not measured.
fn raw_samples() -> impl Strategy<Value = (SampleType, usize, Vec<f64>)> {
    (0..TYPES.len(), 1_usize..40, 1_usize..40, any::<u64>(), 0_u32..64, 0_u32..4).prop_map(
        |(kind, rows, columns, seed, shift, holes)| {
            let mut state = seed | 1;
            let mut next = || {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                state
            };
            let of = |_| {
                let (bits, hole) = (next(), next() % 16);
                let is_hole = match holes {
                    0 => false,
                    1 => hole == 0,
                    2 => hole < 8,
                    _ => true,
                };
                if is_hole { f64::NAN } else { value(TYPES[kind], bits, shift) }
            };
            (TYPES[kind], columns, (0..rows * columns).map(of).collect())
        },
    )
}

/// Errors of many sizes, with few significant bits and with all.
fn errors() -> impl Strategy<Value = f64> {
    let parts = prop_oneof![Just(1.0), Just(1.5), Just(1.6), 1.0..2.0];
    (parts, prop_oneof![-12..40_i32, -1000..1000_i32]).prop_map(|(part, power)| part * 2.0_f64.powi(power))
}

/// Samples that are rounded, or not.
fn samples() -> impl Strategy<Value = (Values, usize, Vec<f64>)> {
    (raw_samples(), prop::option::of(errors())).prop_map(|((kind, columns, mut stored), error)| {
        let values = error.map_or(Values::all(kind), |error| Values::within(kind, Scale::NONE, error));
        values.round(&mut stored);
        (values, columns, stored)
    })
}

fn scales() -> impl Strategy<Value = Scale> {
    let other = (prop_oneof![0.001..1000.0, Just(-0.1)], prop_oneof![Just(0.0), -1e4..1e4])
        .prop_map(|(slope, intercept)| Scale { slope, intercept });
    prop_oneof![Just(Scale::NONE), Just(Scale { slope: -0.25, intercept: 0.0 }), other]
}

proptest! {
    #[test]
    fn every_bit_comes_back((values, columns, stored) in samples(), tail in prop::collection::vec(any::<u8>(), 0..9)) {
        let mut bytes = vec![7];
        encode(&values, &stored, columns, &mut bytes);
        let len = bytes.len() - 1;
        bytes.extend(tail);
        let mut back = vec![1.0; stored.len()];
        prop_assert_eq!(decode(&values, &bytes[1..], columns, &mut back), Some(len));
        for (back, stored) in back.iter().zip(&stored) {
            let expected = if stored.is_finite() { stored.to_bits() } else { f64::NAN.to_bits() };
            prop_assert_eq!(back.to_bits(), expected);
        }
        // Every end that is too early is seen.
        for len in 0..len {
            prop_assert_eq!(decode(&values, &bytes[1..1 + len], columns, &mut back), None);
        }
    }

    #[test]
    fn rounded_samples_are_within_the_bound((kind, _, stored) in raw_samples(), error in errors(), scale in scales()) {
        let values = Values::within(kind, scale, error);
        let mut stored = stored;
        if let Some(step) = values.step().filter(|_| kind.is_float()) {
            // Next to the middles between two multiples.
            for value in stored.iter_mut().step_by(3) {
                *value = Values::all(kind).nearest(((*value / step).floor() + 0.5) * step);
            }
        }
        let mut rounded = stored.clone();
        values.round(&mut rounded);
        for (rounded, stored) in rounded.iter().zip(&stored) {
            prop_assert_eq!(rounded.is_finite(), stored.is_finite());
            let [there, here] = [rounded, stored].map(|stored| scale.value(*stored));
            if there.is_finite() && here.is_finite() {
                prop_assert!((there - here).abs() <= error, "{stored} became {rounded}");
                prop_assert_eq!(values.nearest(*rounded).to_bits(), rounded.to_bits());
            }
        }
        // And no more values than that takes: of floats a ninth of a step at most is given away.
        if scale == Scale::NONE {
            match values.step() {
                Some(step) if kind.is_float() => prop_assert!((1.0..1.125).contains(&(2.0 * error / step)) || step > 9e289),
                Some(step) => prop_assert!((step - 1.0) / 2.0 <= error && ((step + 1.0) / 2.0 > error || step > 500.0)),
                None => {
                    let least = if kind.is_float() { 1e-40 } else { 1.0 };
                    prop_assert!(error < least);
                }
            }
        }
    }

    #[test]
    fn bytes_that_nobody_wrote_are_refused_or_read((values, columns, stored) in samples(), flips in prop::collection::vec((any::<u32>(), any::<u8>()), 1..9), cut in any::<u32>()) {
        let mut bytes = Vec::new();
        encode(&values, &stored, columns, &mut bytes);
        for (at, value) in flips {
            let at = at as usize % bytes.len();
            bytes[at] = value;
        }
        let mut back = vec![0.0; stored.len()];
        for len in [bytes.len(), cut as usize % (bytes.len() + 1)] {
            if let Some(taken) = decode(&values, &bytes[..len], columns, &mut back) {
                prop_assert!(taken <= len);
                prop_assert!(back.iter().all(|value| !value.is_infinite()));
            }
            let mut out = vec![0; stored.len()];
            let _ = decode_bytes(&bytes[..len], columns, &mut out);
        }
    }

    #[test]
    fn planes_come_back(columns in 1_usize..50, values in prop::collection::vec(any::<u8>(), 0..2000)) {
        let values = &values[..values.len() / columns * columns];
        let mut bytes = Vec::new();
        encode_bytes(values, columns, &mut bytes);
        let mut back = vec![0; values.len()];
        prop_assert_eq!(decode_bytes(&bytes, columns, &mut back), Some(bytes.len()));
        prop_assert_eq!(back, values);
    }
}

#[test]
fn planes_and_constants_take_next_to_nothing() {
    let plane: Vec<f64> = (0..257 * 257).map(|at| f64::from(3 * (at / 257) - 2 * (at % 257))).collect();
    let mut bytes = Vec::new();
    encode(&Values::all(SampleType::I16), &plane, 257, &mut bytes);
    assert!(bytes.len() < 3000, "{}", bytes.len());
}

#[test]
#[ignore = "measures"]
fn speed() {
    let side = 259;
    let mut state = 1_u64;
    let mut noise = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (0..4).map(|part| (state >> (16 * part) & 0xffff) as f64).sum::<f64>() / 65536.0 - 2.0
    };
    let stored: Vec<f64> =
        (0..side * side).map(|at| (5000.0 * (f64::from(at % side) * 0.01).sin() + 60.0 * noise()).round()).collect();
    let (values, mut bytes) = (Values::all(SampleType::I16), Vec::new());
    let start = std::time::Instant::now();
    for _ in 0..50 {
        bytes.clear();
        encode(&values, &stored, side as usize, &mut bytes);
    }
    let encoding = start.elapsed().as_secs_f64() / 50.0;
    let mut back = vec![0.0; stored.len()];
    let start = std::time::Instant::now();
    for _ in 0..50 {
        decode(&values, &bytes, side as usize, &mut back).unwrap();
    }
    let decoding = start.elapsed().as_secs_f64() / 50.0;
    assert_eq!(back, stored);
    let million = stored.len() as f64 / 1e6;
    println!(
        "{:.2} bits, encode {:.0} M/s, decode {:.0} M/s",
        bytes.len() as f64 * 8.0 / stored.len() as f64,
        million / encoding,
        million / decoding
    );
}
