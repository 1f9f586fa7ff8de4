//! Where one visitor's pictures are drawn, on a thread of its own: what one picture has read is there for the next.

use super::asked::{FrameAsked, FrameFormat, PickAsked};
use super::drawer::{Outcome, Task};
use super::shown::Shown;
use crate::annotate::Units;
use crate::color::{Image, output};
use crate::command_line::jpeg::jpeg;
use crate::look::Shot;
use crate::picture::asked::{ChannelValues, Failure, State, channels, facts, units_and_ends};
use crate::picture::{AnySession, Picture};
use crate::tour::Show;
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::Arc;

/// Quality of pictures that are looked at for a moment.
const QUALITY: u8 = 80;

/// What is open for a visitor: the data, or a tour of it. What a picture that was given up has left behind is not used again.
pub(super) struct Studio {
    shown: Arc<Shown>,
    state: Arc<State>,
    session: Option<AnySession>,
    show: Option<Show>,
    last: Option<Last>,
}

/// The numbers of the last picture.
struct Last {
    size: (u32, u32),
    channels: Vec<(&'static str, ChannelValues)>,
    units: Value,
}

impl Studio {
    /// Pictures of what is shown; `state` says whether anybody waits for the one that is drawn.
    pub(super) fn new(shown: Arc<Shown>, state: Arc<State>) -> Studio {
        Studio { shown, state, session: None, show: None, last: None }
    }

    /// Does what is asked.
    pub(super) fn perform(&mut self, task: &Task) -> Outcome {
        let done = match task {
            Task::Frame(asked) => self.frame(asked),
            Task::Pick(asked) => self.pick(asked),
        };
        // Nobody reads what there was to tell.
        self.state.take_notes();
        done.unwrap_or_else(|error| Outcome::Failed(error.to_string()))
    }

    fn frame(&mut self, asked: &FrameAsked) -> Result<Outcome, Failure> {
        let (image, facts) = match asked.tour {
            Some(time) => self.of_tour(asked, time)?,
            None => self.still(asked)?,
        };
        let (kind, bytes) = match asked.format {
            FrameFormat::Png => ("image/png", output::png(&image)?),
            FrameFormat::Jpeg => ("image/jpeg", jpeg(&image, QUALITY)?),
        };
        Ok(Outcome::Frame { kind, bytes: bytes.into(), facts })
    }

    fn still(&mut self, asked: &FrameAsked) -> Result<(Image, Value), Failure> {
        self.show = None;
        let asked = asked.asked(&self.shown)?;
        let mut members = [self.shown.member.clone()];
        let (mut shot, options) = asked.request(&mut members, &*self.state)?;
        let mut session = match self.session.take() {
            Some(session) => session,
            None => self.shown.session(options, std::slice::from_ref(&shot), self.state.clone())?,
        };
        let drawn = asked.recolor(&mut session, &mut shot).map_err(Failure::from);
        let drawn = drawn.and_then(|()| drawn_of(&mut session, &shot));
        self.session = Some(session);
        let (image, picture, units, ends) = drawn?;
        let mut facts = facts(&picture, &shot, units.as_ref());
        facts["size"] = json!([image.width, image.height]);
        // It would not fit into a header.
        facts["legend"] = Value::Null;
        let size = (image.width, image.height);
        self.last = Some(Last { size, channels: channels(picture, ends), units: facts["units"].clone() });
        Ok((image, facts))
    }

    fn of_tour(&mut self, asked: &FrameAsked, time: f64) -> Result<(Image, Value), Failure> {
        (self.session, self.last) = (None, None);
        let size = asked.size()?;
        let mut show = match self.show.take().filter(|show| show.tour.size == size) {
            Some(show) => show,
            None => self.shown.show(size, self.state.clone())?,
        };
        let time = time.clamp(0.0, show.duration());
        let taken = show.shot(time, Path::new("tour")).and_then(|scene| show.take(&scene, None));
        self.show = Some(show);
        let taken = taken?;
        let (mode, size) = (taken.picture.annotation.depiction.mode.name, [taken.image.width, taken.image.height]);
        let milliseconds = taken.picture.milliseconds;
        Ok((taken.image, json!({ "mode": mode, "size": size, "time": time, "milliseconds": milliseconds })))
    }

    fn pick(&self, asked: &PickAsked) -> Result<Outcome, Failure> {
        let last = self.last.as_ref().ok_or("pick: found no picture, expected one before it")?;
        let (width, height) = last.size;
        let pixel = |share: f64, side: u32| ((share * f64::from(side)) as usize).min(side.saturating_sub(1) as usize);
        let index = pixel(asked.at[1], height) * width as usize + pixel(asked.at[0], width);
        let mut values = Map::new();
        for (name, channel) in &last.channels {
            // JSON has no numbers that are not finite.
            let value = match channel {
                ChannelValues::Single(values) => values.get(index).map(|value| f64::from(*value)),
                ChannelValues::Double(values) => values.get(index).copied(),
            };
            values.insert((*name).to_owned(), json!(value.filter(|value| value.is_finite())));
        }
        let mut found = json!({ "values": values, "units": last.units });
        if let Some(probe) = asked.probe().filter(|_| self.shown.has_particles()) {
            let probe = probe.answer(&self.shown.member.path, &self.state)?;
            found["probe"] = json!({ "count": probe.count, "mass": probe.mass });
        }
        Ok(Outcome::Picked(found))
    }
}

/// The picture of a shot, its colours, its units, and the ends of its attribute.
type Drawn = (Image, Picture, Option<Units>, Option<[f64; 2]>);

fn drawn_of(session: &mut AnySession, shot: &Shot) -> Result<Drawn, Failure> {
    let picture = session.draw(shot)?;
    let image = session.finished(shot, &picture)?;
    let (units, ends) = units_and_ends(session, &picture);
    Ok((image, picture, units, ends))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build};
    use crate::serve::view::ViewOptions;
    use crate::synth::{dataset, merger::Merger};

    #[test]
    fn visitors_share_the_memory_evenly() {
        const MEMORY: u64 = 3 << 30;
        let folder = tempfile::tempdir().unwrap();
        let [path, tour] = ["merger.df", "a.tour.ron"].map(|name| folder.path().join(name));
        build(dataset(&Merger::new(1, 500)), &BuildOptions::default(), &path, &()).unwrap();
        let text = "(version: 1, keyframes: [(mode: \"column-density\"), (after: 1.0, orbit: 40.0)])";
        std::fs::write(&tour, text).unwrap();
        for (visitors, share) in [(1, MEMORY), (3, MEMORY / 3)] {
            let (path, tour, share) = (path.clone(), Some(tour.clone()), Some(share));
            let options = ViewOptions { path, scene: None, tour, visitors, memory: MEMORY };
            let shown = Arc::new(Shown::open(&options).unwrap());
            let draw = |studio: &mut Studio, asked: Value| {
                let task = Task::Frame(Box::new(serde_json::from_value(asked).unwrap()));
                if let Outcome::Failed(why) = studio.perform(&task) {
                    panic!("{why}");
                }
                // Pictures and tours have it in turns.
                let picture = studio.session.as_ref().map(AnySession::memory);
                [picture, studio.show.as_ref().map(Show::memory)]
            };
            // Who has come before takes nothing of what others have.
            let mut studios = [(); 2].map(|()| Studio::new(Arc::clone(&shown), Arc::default()));
            for studio in &mut studios {
                assert_eq!(draw(studio, json!({ "size": [30, 20] })), [Some(share), None]);
                assert_eq!(draw(studio, json!({ "size": [30, 20], "tour": 0.5 })), [None, Some(share)]);
            }
            // Data of all kinds.
            let asked = FrameAsked::default().asked(&shown).unwrap();
            let (_, options) = asked.request(&mut [shown.member.clone()], &()).unwrap();
            assert_eq!([options.memory, options.page_memory, options.chunk_memory], [share; 3]);
        }
    }
}
