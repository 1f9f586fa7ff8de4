//! Bends the picture over an output's window, and darkens what its mask says.

use super::{Bent, OutputWindow, lettering};
use crate::show::rig::Mask;
use crate::window::looking::marks::MarkLayer;
use crate::window::pages::ViewSelection;
use crate::window::paths::Paths;
use crate::window::picture::Picture;
use crate::window::state::notices::Notices;
use crate::window::touring::Player;
use crate::window::written::WrittenHeights;
use bevy::prelude::*;
use bevy_egui::{EguiContexts, egui};
use std::path::Path;

/// Draws everything of the window.
pub fn draw_output(
    mut contexts: EguiContexts,
    mut output: ResMut<OutputWindow>,
    (mut layer, mut written, mut paths): (ResMut<MarkLayer>, ResMut<WrittenHeights>, ResMut<Paths>),
    (player, mut notices): (Res<Player>, ResMut<Notices>),
    picture: Res<Picture>,
    selection: Res<ViewSelection>,
) -> Result {
    let ctx = contexts.ctx_mut()?.clone();
    // Points are as the picture's: what is bent are shares of both.
    let window = ctx.viewport_rect();
    let painter = ctx.layer_painter(egui::LayerId::background());
    painter.rect_filled(window, 0.0, egui::Color32::BLACK);
    let OutputWindow { bent, mask, words, .. } = output.bypass_change_detection();
    let Some(bent) = bent else { return Ok(()) };
    let tint = layer.tint();
    let (written, paths) = (written.bypass_change_detection(), paths.bypass_change_detection());
    let (marked, written) = match &selection.view {
        Some(view) => (layer.textures(&ctx, view), written.textures(&ctx, view)),
        None => (&[][..], &[][..]),
    };
    let tint = if marked.is_empty() { egui::Color32::WHITE } else { tint };
    let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
    painter.add(bend(bent, picture.texture, whole, window, tint));
    // In the order that the presenter's window has them in.
    for (texture, place) in written.iter().chain(paths.textures(&ctx)).chain(marked) {
        painter.add(bend(bent, texture.id(), *place, window, egui::Color32::WHITE));
    }
    if let Some(state) = player.state() {
        let folder = player.path().and_then(Path::parent).map(Path::to_owned).unwrap_or_default();
        match words.write(&ctx, state, &folder, bent.projector.sheet(bent.fov_y).aspect()) {
            Ok(Some(texture)) => drop(painter.add(lettering::lay(bent, texture, window))),
            Ok(None) => {}
            Err(error) => notices.error(error.to_string()),
        }
    }
    if let Some(light) = bent.projector.mask() {
        let texture = mask.get_or_insert_with(|| {
            let image = shade(light, ctx.input(|input| input.max_texture_side));
            ctx.load_texture("mask", image, egui::TextureOptions::LINEAR)
        });
        painter.image(texture.id(), window, whole, egui::Color32::WHITE);
    }
    Ok(())
}

/// The mesh with a texture that has the part `place` of the picture.
fn bend(
    bent: &Bent,
    texture: egui::TextureId,
    place: egui::Rect,
    window: egui::Rect,
    color: egui::Color32,
) -> egui::Mesh {
    let mut mesh = egui::Mesh::with_texture(texture);
    let last = [bent.mesh.columns - 1, bent.mesh.rows - 1].map(|last| last.max(1) as f32);
    for (i, point) in bent.mesh.points.iter().enumerate() {
        let (x, y) = (i as u32 % bent.mesh.columns, i as u32 / bent.mesh.columns);
        let pos = window.lerp_inside(egui::vec2(x as f32 / last[0], y as f32 / last[1]));
        let [u, v] = point.unwrap_or([0.0; 2]);
        let uv = egui::pos2((u - place.min.x) / place.width(), (v - place.min.y) / place.height());
        mesh.vertices.push(egui::epaint::Vertex { pos, uv, color });
    }
    let is_part = place.width() < 1.0 || place.height() < 1.0;
    for [a, b, c, d] in bent.mesh.cells() {
        let inside = |at: u32| {
            let uv = mesh.vertices[at as usize].uv;
            (0.0..=1.0).contains(&uv.x) && (0.0..=1.0).contains(&uv.y)
        };
        if is_part && ![a, b, c, d].into_iter().any(inside) {
            continue;
        }
        mesh.indices.extend([a, b, c, b, d, c]);
    }
    mesh
}

/// The mask as a black picture that lets its light through, with sides of `most` pixels at most.
fn shade(mask: &Mask, most: usize) -> egui::ColorImage {
    let most = most.clamp(1, 8192) as u32;
    let [width, height] = [mask.width, mask.height].map(|side| side.min(most));
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let at = [(f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height)];
            pixels.push(egui::Color32::from_black_alpha(cover(mask.at(at))));
        }
    }
    egui::ColorImage::new([width as usize, height as usize], pixels)
}

/// How much of what is below a black layer hides so that a share of its light is left. The window's surface is sRGB, into which
/// layers are mixed in linear light.
fn cover(light: f32) -> u8 {
    (255.0 * (1.0 - light.clamp(0.0, 1.0))).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_hides_what_its_light_leaves() {
        assert_eq!((cover(1.0), cover(0.0)), (0, 255));
        for light in [0.1f32, 0.3, 0.5, 0.8] {
            let left = 1.0 - f32::from(cover(light)) / 255.0;
            assert!((left - light).abs() < 0.003, "{light}: {left}");
        }
        let mask = Mask { width: 2, height: 1, light: vec![0.0, 1.0] };
        assert_eq!(shade(&mask, 64).pixels, [egui::Color32::from_black_alpha(255), egui::Color32::TRANSPARENT]);
        assert_eq!(shade(&mask, 1).size, [1, 1]);
    }
}
