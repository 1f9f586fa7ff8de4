//! How an eye follows light: by an exponential in time, fast where it gets brighter and slowly where it gets darker.

/// Time that an eye remembers, in its longer time constant: of what was before, exp(-8) is left, a three-thousandth.
const MEMORY: f64 = 8.0;

/// Parts of the time between two measurements in which it gets either brighter or darker, so that the eye is as fast as there.
const PARTS: u32 = 16;

/// An eye's time constants, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Eye {
    pub bright: f64,
    pub dark: f64,
}

impl Eye {
    /// How far back in time what was seen matters, seconds.
    pub fn memory(self) -> f64 {
        MEMORY * self.bright.max(self.dark)
    }

    /// What an eye that is adapted to the range `state` is adapted to `seconds` later, where what is seen goes evenly from one range to the
    /// other within `width` seconds.
    ///
    /// For `g(t) = g0 + v t` the solution of `x' = (g - x) / tau` is `x(t) = g(t) - v tau + (x0 - g0 + v tau) exp(-t / tau)`.
    pub fn follow(self, mut state: [f64; 2], from: [f64; 2], to: [f64; 2], (width, seconds): (f64, f64)) -> [f64; 2] {
        if width <= 0.0 {
            return state;
        }
        let speed = [0, 1].map(|k| (to[k] - from[k]) / width);
        let part = width / f64::from(PARTS);
        for index in 0..PARTS {
            let begin = part * f64::from(index);
            let time = (seconds - begin).min(part);
            if time <= 0.0 {
                break;
            }
            let seen = [0, 1].map(|k| from[k] + speed[k] * begin);
            let tau = if seen[1] + 0.5 * speed[1] * part > state[1] { self.bright } else { self.dark };
            let left = (-time / tau).exp();
            state = [0, 1].map(|k| {
                let lag = speed[k] * tau;
                seen[k] + speed[k] * time - lag + (state[k] - seen[k] + lag) * left
            });
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYE: Eye = Eye { bright: 0.3, dark: 1.5 };

    #[test]
    fn a_still_scene_is_approached_by_an_exponential() {
        for (start, tau) in [(-2.0, EYE.bright), (3.0, EYE.dark)] {
            let to = [0.0, 1.0];
            for seconds in [0.0, 0.01, 0.3, 0.77, 1.0] {
                let found = EYE.follow([to[0] + start, to[1] + start], to, to, (1.0, seconds));
                let expected = start * f64::exp(-seconds / tau);
                assert!((0..2).all(|k| (found[k] - to[k] - expected).abs() < 1e-12), "{found:?} {expected}");
            }
        }
    }

    #[test]
    fn behind_what_gets_brighter_evenly_it_stays_by_its_time_constant() {
        let mut state = [0.0, 1.0];
        for step in 0..20 {
            let seen = |step: i32| [f64::from(step), f64::from(step) + 1.0];
            state = EYE.follow(state, seen(step), seen(step + 1), (0.5, 0.5));
        }
        // Two a second.
        assert!((state[1] - (21.0 - 2.0 * EYE.bright)).abs() < 1e-9, "{state:?}");
    }
}
