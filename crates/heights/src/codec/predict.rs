//! What a sample is expected to be from those left of it and above it; what is left is small.
//!
//! Each row has the predictor that leaves least. All arithmetic is modulo 2^64, so that words of any size come back.

use deepfield_data::lanes::in_lanes;

/// How a sample is predicted from `left`, `up` and `up_left`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Predictor {
    /// `left + up - up_left`: nothing is left of planes.
    Plane,
    /// `(3 left + 3 up - 2 up_left) / 4`: what is half a plane and half a mean; best for rough surfaces.
    Half,
    /// `(left + up) / 2`: best for noise.
    Mean,
    /// `left`.
    Left,
    /// 0: for what is a rest already.
    Zero,
}

impl Predictor {
    pub(super) const ALL: [Predictor; 5] =
        [Predictor::Plane, Predictor::Half, Predictor::Mean, Predictor::Left, Predictor::Zero];

    /// By its number in the bytes.
    pub(super) fn numbered(number: u8) -> Option<Predictor> {
        Predictor::ALL.get(usize::from(number)).copied()
    }

    #[inline(always)]
    fn of(self, left: i64, up: i64, up_left: i64) -> i64 {
        match self {
            Predictor::Plane => left.wrapping_add(up).wrapping_sub(up_left),
            Predictor::Half => {
                let sum = left.wrapping_add(up);
                sum.wrapping_mul(3).wrapping_sub(up_left.wrapping_mul(2)).wrapping_add(2) >> 2
            }
            Predictor::Mean => left.wrapping_add(up).wrapping_add(1) >> 1,
            Predictor::Left => left,
            Predictor::Zero => 0,
        }
    }
}

/// What is left of a row; `above` is the row before, or nothing. The first sample is predicted by the one above.
pub(super) fn differences(predictor: Predictor, row: &[i64], above: Option<&[i64]>, out: &mut [i64]) {
    let Some(above) = above else {
        let mut left = 0_i64;
        for (out, &value) in out.iter_mut().zip(row) {
            *out = value.wrapping_sub(left);
            left = value;
        }
        return;
    };
    #[inline(always)]
    fn go(predictor: Predictor, row: &[i64], above: &[i64], out: &mut [i64]) {
        let count = out.len().min(row.len()).min(above.len());
        let (out, row, above) = (&mut out[..count], &row[..count], &above[..count]);
        if count > 0 {
            out[0] = row[0].wrapping_sub(above[0]);
        }
        for at in 1..count {
            out[at] = row[at].wrapping_sub(predictor.of(row[at - 1], above[at], above[at - 1]));
        }
    }
    in_lanes!(match predictor {
        Predictor::Plane => go(Predictor::Plane, row, above, out),
        Predictor::Half => go(Predictor::Half, row, above, out),
        Predictor::Mean => go(Predictor::Mean, row, above, out),
        Predictor::Left => go(Predictor::Left, row, above, out),
        Predictor::Zero => go(Predictor::Zero, row, above, out),
    });
}

/// Turns what is left of a row into the row. Where `valid` says that a sample was not measured, it takes the place's usual stand-in, and
/// what is left for it does not count.
pub(super) fn restore(predictor: Predictor, row: &mut [i64], above: Option<&[i64]>, valid: Option<&[bool]>) {
    let zeros;
    let (predictor, above) = match above {
        Some(above) => (predictor, above),
        None => {
            zeros = vec![0; row.len()];
            (Predictor::Left, zeros.as_slice())
        }
    };
    #[inline(always)]
    fn go(predictor: Predictor, row: &mut [i64], above: &[i64], valid: Option<&[bool]>) {
        let Some((first, rest)) = row.split_first_mut() else { return };
        let is_valid = |at: usize| valid.is_none_or(|valid| valid[at]);
        let up = above.first().copied().unwrap_or_default();
        *first = if is_valid(0) { first.wrapping_add(up) } else { up };
        let mut left = *first;
        match valid {
            None => {
                for (value, ups) in rest.iter_mut().zip(above.windows(2)) {
                    left = value.wrapping_add(predictor.of(left, ups[1], ups[0]));
                    *value = left;
                }
            }
            Some(valid) => {
                for ((value, ups), valid) in rest.iter_mut().zip(above.windows(2)).zip(&valid[1..]) {
                    if *valid {
                        left = value.wrapping_add(predictor.of(left, ups[1], ups[0]));
                    }
                    *value = left;
                }
            }
        }
    }
    match predictor {
        Predictor::Plane => go(Predictor::Plane, row, above, valid),
        Predictor::Half => go(Predictor::Half, row, above, valid),
        Predictor::Mean => go(Predictor::Mean, row, above, valid),
        Predictor::Left => go(Predictor::Left, row, above, valid),
        Predictor::Zero => go(Predictor::Zero, row, above, valid),
    }
}

/// Gives samples that were not measured their stand-ins, as [`restore`] does: the one to the left, in the first column the one above, at the
/// very first place 0.
pub(super) fn stand_in(words: &mut [i64], columns: usize, valid: &[bool]) {
    for at in 0..words.len() {
        if !valid[at] {
            words[at] = match (at % columns, at >= columns) {
                (0, true) => words[at - columns],
                (0, false) => 0,
                _ => words[at - 1],
            };
        }
    }
}
