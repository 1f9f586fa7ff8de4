//! A tour's timetable as text: keyframes, speeds, and what is too fast.

use crate::tour::{Move, Show, remarks};
use std::fmt::Write;

/// The timetable.
pub(super) fn text(show: &Show) -> String {
    let timeline = &show.timeline;
    let mut text = String::new();
    let title = if show.tour.title.is_empty() { "A tour" } else { &show.tour.title };
    let again = if timeline.repeats() { ", again and again" } else { "" };
    let _ = writeln!(text, "{title}: {:.1} s{again}, {} keyframes\n", timeline.duration(), timeline.stops().len());
    let _ =
        writeln!(text, "{:>3}  {:>8}  {:>6}  {:<7}  {:>7}  {:>7}  what", "", "reached", "pause", "way", "turn", "zoom");
    let mut mode = "";
    let mut warnings = 0;
    for (stop, remark) in timeline.stops().iter().zip(remarks(timeline, &show.tour.comfort)) {
        let way = match stop.motion {
            _ if remark.keyframe == 0 => "",
            Move::Glide => "glide",
            Move::Flight => "flight",
            Move::Cut => "cut",
        };
        let state = timeline.state(stop.arrive);
        let mut what: Vec<String> = stop.label.iter().map(|label| format!("[{label}]")).collect();
        let own = state.look.mode.map_or("", |mode| mode.name);
        if own != mode {
            what.push(own.to_owned());
            mode = own;
        }
        if !state.caption.text.is_empty() {
            what.push(format!("\"{}\"", state.caption.text.replace('\n', " / ")));
        }
        let _ = writeln!(
            text,
            "{:>3}  {:>6.1} s  {:>4.1} s  {way:<7}  {:>3.0} °/s  {:>4.1} /s  {}",
            remark.keyframe + 1,
            stop.arrive,
            stop.leave - stop.arrive,
            remark.turn,
            remark.zoom,
            what.join(" ")
        );
        for warning in &remark.warnings {
            let _ = writeln!(text, "     ! {warning}");
            warnings += 1;
        }
    }
    let plural = if warnings == 1 { "" } else { "s" };
    let _ = writeln!(
        text,
        "\n{}",
        if warnings > 0 { format!("{warnings} warning{plural}") } else { "nothing is too fast".into() }
    );
    text
}
