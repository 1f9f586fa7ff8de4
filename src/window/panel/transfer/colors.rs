//! The colour map: chosen from a list with swatches, reversed, or made of stops of one's own.

use crate::color::colormap::{ColorMap, HexColor, MOST_STOPS, Stop};
use crate::window::state::choices::Choices;
use crate::window::theme;
use bevy_egui::egui::{DragValue, Sense, Ui, vec2};

/// Stops that a map begins with when it is taken apart.
const BEGINNING: usize = 5;

/// The chooser, and the stops of a map that is made of them.
pub fn show(ui: &mut Ui, choices: &Choices, map: &mut ColorMap, reverse: &mut bool) {
    let name = map.name();
    theme::combo(ui, "Colour map", name, |ui| {
        for (choice, colors) in choices.color_maps() {
            ui.horizontal(|ui| {
                let (rect, swatch) = ui.allocate_exact_size(vec2(64.0, 12.0), Sense::CLICK);
                let last = colors.len().saturating_sub(1);
                theme::gradient(ui.painter(), rect, false, |t| colors[(t * last as f32).round() as usize]);
                let label = ui.selectable_label(map == choice, choice.name()).on_hover_text(choice.help());
                theme::register(ui, &format!("colour-map:{}", choice.name()), label.rect);
                if label.clicked() || swatch.clicked() {
                    *map = choice.clone();
                }
            });
        }
        ui.separator();
        if ui.selectable_label(map.stops().is_some(), "stops of your own").clicked()
            && map.stops().is_none()
            && let Ok(own) = ColorMap::through(taken_apart(map))
        {
            *map = own;
        }
    });
    theme::switch(ui, "Reversed", reverse);
    if let Some(stops) = map.stops()
        && let Some(edited) = edit_stops(ui, stops)
        && let Ok(edited) = ColorMap::through(edited)
    {
        *map = edited;
    }
}

/// A few colours of a map as stops.
fn taken_apart(map: &ColorMap) -> Vec<Stop> {
    let byte = |component: f32| (255.0 * component).round() as u8;
    let stop = |(index, color): (usize, [f32; 3])| (index as f32 / (BEGINNING - 1) as f32, HexColor(color.map(byte)));
    map.sample(BEGINNING).into_iter().enumerate().map(stop).collect()
}

/// Places and colours of stops; a stop may be added between two or taken away.
fn edit_stops(ui: &mut Ui, stops: &[Stop]) -> Option<Vec<Stop>> {
    let mut edited = stops.to_vec();
    let (mut add, mut remove) = (None, None);
    for (index, stop) in edited.iter_mut().enumerate() {
        let low = index.checked_sub(1).map_or(0.0, |before| stops[before].0 + 0.001);
        let high = stops.get(index + 1).map_or(1.0, |after| after.0 - 0.001);
        theme::row(ui, &format!("Stop {}", index + 1), |ui| {
            let [take, another] = ["take this stop away", "another stop before the next one"];
            let button = ui.small_button("−").on_hover_text(take);
            theme::call(&button, take);
            if button.clicked() {
                remove = Some(index);
            }
            let button = ui.small_button("+").on_hover_text(another);
            theme::call(&button, another);
            if button.clicked() {
                add = Some(index);
            }
            let place = DragValue::new(&mut stop.0).range(low..=high.max(low)).speed(0.003).max_decimals(3);
            theme::call(&ui.add(place), &format!("Place of stop {}", index + 1));
            theme::call(&ui.color_edit_button_srgb(&mut stop.1.0), &format!("Colour of stop {}", index + 1));
        });
    }
    if let Some(index) = remove.filter(|_| edited.len() > 2) {
        edited.remove(index);
    }
    if let Some(index) = add.filter(|index| edited.len() < MOST_STOPS && index + 1 < edited.len()) {
        let ((from, HexColor(a)), (to, HexColor(b))) = (edited[index], edited[index + 1]);
        let middle = [0, 1, 2].map(|k| a[k].midpoint(b[k]));
        edited.insert(index + 1, (0.5 * (from + to), HexColor(middle)));
    }
    (edited != stops).then_some(edited)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_taken_apart_is_nearly_the_map() {
        for map in ColorMap::all() {
            let own = ColorMap::through(taken_apart(&map)).unwrap();
            let [a, b] = [&map, &own].map(|map| map.sample(5));
            assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 0.01), "{map}");
        }
    }
}
