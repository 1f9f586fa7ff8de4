//! Plots as SVG: the series of a flight over its time, and the frame rate over the size of the picture.

use super::super::splat::Failure;
use super::series::{Frame, series};
use plotters::prelude::*;

/// Width of a plot and height of each panel, pixels.
const PANEL: (u32, u32) = (900, 150);
/// Points of a line at most.
const MOST_POINTS: usize = 2000;
const INK: RGBColor = RGBColor(0x1f, 0x5f, 0xa8);

/// The seven series, one panel each, over the seconds of the flight.
///
/// # Errors
/// When the plot cannot be drawn, which would be a defect of the plotting library.
pub fn flight(frames: &[Frame]) -> Result<String, Failure> {
    let mut text = String::new();
    let first = frames.first().map_or(0.0, |frame| frame.seconds);
    let last = frames.last().map_or(1.0, |frame| frame.seconds).max(first + 1e-3);
    let series = series(frames);
    {
        let root = SVGBackend::with_string(&mut text, (PANEL.0, PANEL.1 * series.len() as u32)).into_drawing_area();
        root.fill(&WHITE)?;
        for (area, series) in root.split_evenly((series.len(), 1)).iter().zip(&series) {
            let most = series.values.iter().copied().fold(0.0, f64::max);
            let mut chart = ChartBuilder::on(area)
                .caption(series.name, ("sans-serif", 15))
                .margin(6)
                .x_label_area_size(18)
                .y_label_area_size(64)
                .build_cartesian_2d(first..last, 0.0..if most > 0.0 { 1.08 * most } else { 1.0 })?;
            chart.configure_mesh().light_line_style(WHITE).x_labels(12).y_labels(5).draw()?;
            let points = frames.iter().zip(&series.values).map(|(frame, &value)| (frame.seconds, value));
            let stride = frames.len().div_ceil(MOST_POINTS).max(1);
            chart.draw_series(LineSeries::new(points.step_by(stride), &INK))?;
        }
        root.present()?;
    }
    Ok(text)
}

/// Frame rate (mean and standard deviation) over the number of pixels, as in F12's figure 4.11.
///
/// # Errors
/// As [`flight`].
pub fn sweep(points: &[((u32, u32), f64, f64)]) -> Result<String, Failure> {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, (PANEL.0, 420)).into_drawing_area();
        root.fill(&WHITE)?;
        let pixels = |size: (u32, u32)| f64::from(size.0) * f64::from(size.1) / 1e6;
        let widest = points.iter().map(|point| pixels(point.0)).fold(0.1, f64::max);
        let most = points.iter().map(|point| point.1 + point.2).fold(1.0, f64::max);
        let mut chart = ChartBuilder::on(&root)
            .caption("frames per second over million pixels", ("sans-serif", 15))
            .margin(8)
            .x_label_area_size(24)
            .y_label_area_size(52)
            .build_cartesian_2d(0.0..1.1 * widest, 0.0..1.1 * most)?;
        chart.configure_mesh().light_line_style(WHITE).draw()?;
        chart.draw_series(LineSeries::new(points.iter().map(|point| (pixels(point.0), point.1)), &INK))?;
        chart.draw_series(points.iter().map(|&(size, rate, deviation)| {
            ErrorBar::new_vertical(pixels(size), (rate - deviation).max(0.0), rate, rate + deviation, INK.filled(), 8)
        }))?;
        chart.draw_series(points.iter().map(|&(size, rate, _)| {
            let label = Text::new(format!("{}x{}", size.0, size.1), (8, -16), ("sans-serif", 12));
            EmptyElement::at((pixels(size), rate)) + label
        }))?;
        root.present()?;
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_are_svg_with_a_line_for_each_series() {
        let frames: Vec<Frame> = (0..5000)
            .map(|i| Frame { seconds: 0.01 * f64::from(i), frame_ms: 10.0, particles: 7, ..Frame::default() })
            .collect();
        let text = flight(&frames).unwrap();
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        assert!(text.matches("<polyline").count() >= 7, "{}", text.matches("<polyline").count());
        assert!(text.len() < 1 << 20);
        flight(&[]).unwrap();
        let text = sweep(&[((600, 400), 60.0, 2.0), ((1200, 800), 30.0, 4.0)]).unwrap();
        assert!(text.contains("1200x800"));
    }
}
