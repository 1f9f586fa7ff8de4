//! Moments of a run: how a user names one, and where it lies between the steps that are stored.

use super::{redshift_of, scale_factor_of};
use serde::de::{Error as _, Unexpected};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// A moment as a user names it. On the command line `9.6`, `step:12`, `z:1.5`, `a:0.4` or `last`; in RON `9.6`, `step(12)`,
/// `redshift(1.5)`, `scale_factor(0.4)` or `last`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum When {
    /// A time in the unit of the steps' own times: the time of the snapshots' headers; of comoving data the scale factor.
    Time(f64),
    /// A stored step, from 0.
    Step(u32),
    /// A redshift.
    Redshift(f64),
    /// A scale factor.
    ScaleFactor(f64),
    /// The last step.
    Last,
}

/// What the command line takes.
const WORDS: &str = "a time such as 9.6, step:12, z:1.5, a:0.4 or last";

impl FromStr for When {
    type Err = String;

    fn from_str(text: &str) -> Result<When, String> {
        let expected = || format!("expected {WORDS}");
        let finite = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(expected);
        match text.trim().split_once(':') {
            None if text.trim() == "last" => Ok(When::Last),
            None => Ok(When::Time(finite(text)?)),
            Some(("step", number)) => number.trim().parse().map(When::Step).map_err(|_| expected()),
            Some(("z", value)) => Ok(When::Redshift(finite(value)?)),
            Some(("a", value)) => Ok(When::ScaleFactor(finite(value)?)),
            Some(_) => Err(expected()),
        }
    }
}

/// As on the command line.
impl fmt::Display for When {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            When::Time(time) => write!(f, "{time}"),
            When::Step(step) => write!(f, "step:{step}"),
            When::Redshift(redshift) => write!(f, "z:{redshift}"),
            When::ScaleFactor(factor) => write!(f, "a:{factor}"),
            When::Last => f.write_str("last"),
        }
    }
}

/// What is no plain number, in RON.
#[derive(Serialize, Deserialize)]
#[serde(rename = "When", rename_all = "snake_case")]
enum Named {
    Step(u32),
    Redshift(f64),
    ScaleFactor(f64),
    Last,
}

impl Serialize for When {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            When::Time(time) => return time.serialize(serializer),
            When::Step(step) => Named::Step(step),
            When::Redshift(redshift) => Named::Redshift(redshift),
            When::ScaleFactor(factor) => Named::ScaleFactor(factor),
            When::Last => Named::Last,
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for When {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<When, D::Error> {
        // A number or a variant: RON tells them apart only by their text.
        let raw = <&ron::value::RawValue>::deserialize(deserializer)?;
        let text = raw.get_ron().trim();
        let when = match text.parse::<f64>() {
            Ok(time) => When::Time(time),
            Err(_) => match ron::from_str(text) {
                Ok(Named::Step(step)) => When::Step(step),
                Ok(Named::Redshift(redshift)) => When::Redshift(redshift),
                Ok(Named::ScaleFactor(factor)) => When::ScaleFactor(factor),
                Ok(Named::Last) => When::Last,
                Err(_) => {
                    let expected = "a time such as 9.6, step(12), redshift(1.5), scale_factor(0.4) or last";
                    return Err(D::Error::invalid_value(Unexpected::Other(text), &expected));
                }
            },
        };
        match when {
            When::Time(value) | When::Redshift(value) | When::ScaleFactor(value) if !value.is_finite() => {
                Err(D::Error::invalid_value(Unexpected::Float(value), &"a finite number"))
            }
            when => Ok(when),
        }
    }
}

/// A moment of a run by its place: `u` of the way from the step `step` to the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// The stored step at or before the moment.
    pub step: usize,
    /// Place within the interval that begins there, in `[0, 1)`; 0 at a stored step, and always at the last one.
    pub u: f64,
}

/// When each step of a run is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Their times, each larger than the one before; at least one.
    pub times: Vec<f64>,
    /// Their redshifts, where every step has one.
    pub redshifts: Option<Vec<f64>>,
}

/// How far beyond the ends of a run a moment may be, as a share of the run: what numbers lose when they are written down and read.
const ROUNDING: f64 = 1e-9;

impl StepTimes {
    /// A time in the data's words: `t = 9.6`; of comoving data, whose times are scale factors, `z = 1.5, a = 0.4`. Five digits at most.
    pub fn words(&self, time: f64) -> String {
        let tidy = |value: f64| format!("{value:.4e}").parse().unwrap_or(value);
        match self.redshifts {
            Some(_) => format!("z = {}, a = {}", tidy(1.0 / time - 1.0), tidy(time)),
            None => format!("t = {}", tidy(time)),
        }
    }

    /// Where `when` lies.
    ///
    /// # Errors
    /// Why it lies nowhere: it is before the first step or after the last, or the steps have no redshifts. The sentence goes on
    /// after the name of the file and of the moment.
    pub fn moment(&self, when: When) -> Result<Moment, String> {
        let last = self.times.len().saturating_sub(1);
        let scale_factor = |redshift: f64| 1.0 / (1.0 + redshift);
        match when {
            When::Last => Ok(Moment { step: last, u: 0.0 }),
            When::Step(step) if step as usize <= last => Ok(Moment { step: step as usize, u: 0.0 }),
            When::Step(_) => Err(format!("the run has steps 0 to {last}")),
            When::Time(time) => place(&self.times, time).ok_or_else(|| match (self.times.first(), self.times.last()) {
                (Some(first), Some(last)) => format!("the run goes from {first} to {last}"),
                _ => "the run has no steps".into(),
            }),
            When::Redshift(_) | When::ScaleFactor(_) => {
                let redshifts = self.redshifts.as_ref().ok_or("the run's steps have no redshifts")?;
                let factors: Vec<f64> = redshifts.iter().copied().map(scale_factor).collect();
                let (factor, is_redshift) = match when {
                    When::Redshift(redshift) => (scale_factor(redshift), true),
                    When::ScaleFactor(factor) => (factor, false),
                    _ => return Err("it is no scale factor".into()),
                };
                place(&factors, factor).ok_or_else(|| {
                    let ends = |values: &[f64]| [values.first(), values.last()].map(|end| end.copied().unwrap_or(0.0));
                    let [first, last] = ends(if is_redshift { redshifts } else { &factors });
                    let what = if is_redshift { "redshift" } else { "scale factor" };
                    format!("the run goes from {what} {first} to {last}")
                })
            }
        }
    }

    /// The redshift of a moment, whose scale factor is between those of the steps; `None` where steps have none.
    pub fn redshift(&self, moment: Moment) -> Option<f64> {
        let redshifts = self.redshifts.as_ref()?;
        let at = |step: usize| redshifts.get(step).or(redshifts.last()).copied();
        let begin = at(moment.step)?;
        if moment.u <= 0.0 {
            return Some(begin);
        }
        let factors = [scale_factor_of(begin)?, scale_factor_of(at(moment.step + 1)?)?];
        redshift_of(factors[0] + moment.u * (factors[1] - factors[0]))
    }

    /// The time of a moment, in the unit of the steps' times.
    pub fn time(&self, moment: Moment) -> f64 {
        let at = |step: usize| self.times.get(step).or(self.times.last()).copied().unwrap_or(0.0);
        let begin = at(moment.step);
        begin + moment.u * (at(moment.step + 1) - begin)
    }
}

/// Where `value` lies between `values`, which rise; `None` outside.
fn place(values: &[f64], value: f64) -> Option<Moment> {
    let (first, last) = (*values.first()?, *values.last()?);
    let slack = ROUNDING * (last - first).max(last.abs().max(first.abs()) * f64::EPSILON);
    if !(value >= first - slack && value <= last + slack) {
        return None;
    }
    let value = value.clamp(first, last);
    let step = values.partition_point(|begin| *begin <= value).saturating_sub(1);
    let u = match values.get(step + 1) {
        Some(end) => ((value - values[step]) / (end - values[step])).clamp(0.0, 1.0),
        None => 0.0,
    };
    Some(if u < 1.0 { Moment { step, u } } else { Moment { step: step + 1, u: 0.0 } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Holder {
        #[serde(default)]
        time: Option<When>,
        next: u8,
    }

    #[test]
    fn moments_are_named_on_the_command_line_and_in_ron() {
        let all = [
            ("9.6", "9.6", When::Time(9.6)),
            ("-2e-3", "-2e-3", When::Time(-0.002)),
            ("step:12", "step(12)", When::Step(12)),
            ("z:1.5", "redshift(1.5)", When::Redshift(1.5)),
            ("a:0.4", "scale_factor(0.4)", When::ScaleFactor(0.4)),
            ("last", "last", When::Last),
        ];
        let options = ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
        for (word, ron_text, when) in all {
            assert_eq!(word.parse(), Ok(when));
            assert_eq!(when.to_string().parse(), Ok(when));
            let read: Holder = options.from_str(&format!("(time: {ron_text}, next: 3)")).unwrap();
            assert_eq!(read, Holder { time: Some(when), next: 3 });
            let written = options.to_string(&read).unwrap();
            assert_eq!(options.from_str::<Holder>(&written).unwrap(), read, "{written}");
        }
        assert_eq!(options.from_str::<Holder>("(next: 1)").unwrap().time, None);
        for wrong in ["", "steps:1", "step:-1", "step:1.5", "nan", "a:", "z:inf", "later"] {
            assert!(wrong.parse::<When>().unwrap_err().contains("step:12"), "{wrong}");
        }
        for wrong in ["step(1.5)", "step(-1)", "later", "inf", "redshift(nan)", "\"9.6\"", "(9.6)"] {
            assert!(options.from_str::<Holder>(&format!("(time: {wrong}, next: 3)")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_lies_outside_is_told() {
        let times = StepTimes { times: vec![0.0, 9.0, 19.1875], redshifts: None };
        assert_eq!(times.moment(When::Time(30.0)), Err("the run goes from 0 to 19.1875".into()));
        assert_eq!(times.moment(When::Step(3)), Err("the run has steps 0 to 2".into()));
        assert!(times.moment(When::Redshift(1.0)).is_err() && times.moment(When::Time(f64::NAN)).is_err());
        let comoving = StepTimes { times: vec![0.2, 0.5, 1.0], redshifts: Some(vec![4.0, 1.0, 0.0]) };
        assert_eq!(comoving.moment(When::Redshift(1.0)), Ok(Moment { step: 1, u: 0.0 }));
        assert_eq!(comoving.moment(When::ScaleFactor(0.75)), Ok(Moment { step: 1, u: 0.5 }));
        assert_eq!(comoving.moment(When::Redshift(9.0)), Err("the run goes from redshift 4 to 0".into()));
        let one = StepTimes { times: vec![0.3], redshifts: None };
        assert_eq!(one.moment(When::Time(0.3)), Ok(Moment { step: 0, u: 0.0 }));
        assert!(one.moment(When::Time(0.31)).is_err());
    }

    proptest! {
        #[test]
        fn a_moment_has_the_time_that_it_was_named_by(
            steps in prop::collection::vec(1e-3_f64..10.0, 1..20), begin in -50.0_f64..50.0, share in 0.0_f64..=1.0,
        ) {
            let mut times = vec![begin];
            for step in steps {
                times.push(times[times.len() - 1] + step);
            }
            let last = times[times.len() - 1];
            let times = StepTimes { times, redshifts: None };
            for (step, time) in times.times.iter().enumerate() {
                prop_assert_eq!(times.moment(When::Time(*time)).unwrap(), Moment { step, u: 0.0 });
            }
            let time = begin + share * (last - begin);
            let moment = times.moment(When::Time(time)).unwrap();
            prop_assert!((0.0..1.0).contains(&moment.u) && moment.step < times.times.len());
            prop_assert!((times.time(moment) - time).abs() <= 1e-12 * (last - begin + begin.abs()));
        }
    }
}
