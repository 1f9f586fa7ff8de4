//! Code for whatever SIMD lanes the processor has.

/// The value of an expression. It is compiled for each of the instruction sets that `pulp` knows, and the processor takes the best that it has.
/// All operations stay what they are, so that numbers do not depend on lanes.
///
/// Only what is inlined is compiled like this, and the compiler inlines nothing large that several versions call: each function in the
/// expression whose loops count has to be `#[inline(always)]`. To see what became of it, look for `pulp`'s functions `imp_fastcall` and `imp`
/// in `objdump -d -C -r` of the crate's library: either the loops are in there, with registers `ymm` or `zmm`, or there is a call of a closure
/// or of `FnOnce::call_once`, and all is done in the lanes that every processor has.
#[macro_export]
macro_rules! in_lanes {
    ($work:expr) => {
        $crate::lanes::dispatch(
            #[inline(always)]
            || $work,
        )
    };
}

pub use in_lanes;

/// Does the work of [`in_lanes!`]. That a closure is asked for that is called once makes it one: else it might get a function around it that
/// is not always inlined.
#[inline]
pub fn dispatch<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

#[cfg(test)]
mod tests {
    #[inline(always)]
    fn lengths(values: &[f64], out: &mut [f64]) -> f64 {
        let mut most: f64 = 0.0;
        for (out, pair) in out.iter_mut().zip(values.windows(2)) {
            *out = (pair[0] * pair[0] + pair[1] * pair[1] + 0.1).sqrt();
            most = most.max(*out);
        }
        most
    }

    /// Processors that multiply and add in one step, with one rounding, do so only where they are told to.
    #[test]
    fn numbers_do_not_depend_on_lanes() {
        let values: Vec<f64> = (0..207_u32).map(|i| f64::from(i * i % 97) / 7.0).collect();
        let (mut plain, mut wide) = (vec![0.0; 206], vec![0.0; 206]);
        let most = lengths(&values, &mut plain);
        assert_eq!(in_lanes!(lengths(&values, &mut wide)).to_bits(), most.to_bits());
        assert!(plain.into_iter().map(f64::to_bits).eq(wide.into_iter().map(f64::to_bits)));
    }
}
