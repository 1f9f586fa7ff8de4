//! Heights along lines in a picture that somebody else draws, with lines all over it: the pixels that heights stand on are shaded once more, without
//! lines, and letters are written over them. So it is with pictures that are put together of faces, or for two eyes.

use super::labels::eyes::{EyePart, SeenLabel, for_each};
use super::labels::{self, ContourLabel, Letters};
use super::look::{Contours, Look};
use super::photo::PhotoLook;
use super::picture::{self, SurfaceOptions, SurfacePicture, parts};
use super::placed::Placed;
use super::raster::Visibility;
use super::rays::Caster;
use super::shade::Shader;
use super::sight::Sight;
use super::source::SurfaceNodes;
use super::stitch::Scene;
use crate::color::Colors;
use std::sync::Arc;

/// Writes the heights that options ask for into a picture of a field, in which `seen` is what each of its samples shows of a scene, by whomever that
/// was found; the pixels of `sight` are these samples.
pub(crate) fn write(
    picture: &mut SurfacePicture,
    (source, placed): (&dyn SurfaceNodes, &Placed),
    (scene, sight, seen): (&Scene, &Sight, &Visibility),
    options: &SurfaceOptions,
    letters: &dyn Letters,
) {
    let Some(look) = &options.look else { return };
    let Some((contours, em)) = look.contours.and_then(|contours| Some((contours, contours.labels?))) else { return };
    let (parts, photo) = (parts(options.samples), PhotoLook::of(source, look, placed));
    let size = [picture.colors.width, picture.colors.height].map(|pixels| pixels as usize);
    let shader = picture::shader(Shader::new(scene, sight, look, photo, parts), seen, options);
    picture.labels = labels::place(shader.resolver(), seen, parts, (&contours, em), letters);
    picture.labels.retain(|label| !shader.is_behind_wall(label));
    let spared = labels::spared(&picture.labels, size);
    let behind: Vec<usize> = (0..spared.len()).filter(|index| spared[*index]).collect();
    let shader = shader.sparing(size[0], spared);
    for (index, color) in behind.iter().zip(shader.shade_some(seen, size[0], &behind)) {
        picture.colors.rgba[*index] = color;
    }
    labels::paint(&mut picture.colors.rgba, size, &picture.labels, &contours, letters);
}

/// Where heights stand in what is seen of a scene, of which a sample for each pixel is looked at.
pub(super) fn found(
    (scene, sight): (&Scene, &Sight),
    (look, options): (&Look, &SurfaceOptions),
    contours: (&Contours, f64),
    letters: &dyn Letters,
) -> Vec<ContourLabel> {
    let (seen, _) = picture::visible(scene, sight, options, 1);
    let shader = picture::shader(Shader::new(scene, sight, look, None, 1), &seen, options);
    let mut found = labels::place(shader.resolver(), &seen, 1, contours, letters);
    found.retain(|label| !shader.is_behind_wall(label));
    found
}

/// Writes heights into a picture of what each of these eyes sees. Where they stand is found from the `middle`, by a sample for each pixel of a picture
/// from there, and what is behind letters by rays.
pub(crate) fn over(
    picture: &mut SurfacePicture,
    (source, placed): (&dyn SurfaceNodes, &Placed),
    (middle, eyes): (&Sight, &[EyePart]),
    options: &SurfaceOptions,
    letters: &dyn Letters,
) {
    let Some(look) = &options.look else { return };
    let Some((contours, em)) = look.contours.and_then(|contours| Some((contours, contours.labels?))) else { return };
    let scene = picture::scene(source, placed, middle, options);
    let found = found((&scene, middle), (look, options), (&contours, em), letters);
    let (caster, parts) = (Arc::new(Caster::new(&scene)), parts(options.samples));
    let plain = Look { contours: None, ..look.clone() };
    let width = picture.colors.width as usize;
    for (eye, seen) in eyes.iter().zip(for_each(eyes, &found, middle, &caster)) {
        let corner = eye.corner.map(|at| at as usize);
        for of_one in seen.chunk_by(|a, b| a.sight == b.sight) {
            let Some(sight) = of_one.first().map(|seen| seen.sight.refined(parts)) else { continue };
            let photo = PhotoLook::of(source, &plain, placed);
            let shader = Shader::new(&scene, &sight, &plain, photo, parts).casting(&caster);
            let shader = picture::dressed(shader, options);
            let pixels: Vec<[usize; 2]> = of_one.iter().flat_map(SeenLabel::behind).collect();
            for ([x, y], color) in pixels.iter().zip(shader.shade_by_rays(&pixels)) {
                picture.colors.rgba[(corner[1] + y) * width + corner[0] + x] = color;
            }
        }
        picture.labels.extend(seen.into_iter().map(|SeenLabel { mut label, .. }| {
            (0..2).for_each(|k| label.middle[k] += f64::from(eye.corner[k]));
            label
        }));
    }
    let size = [picture.colors.width, picture.colors.height].map(|pixels| pixels as usize);
    labels::paint(&mut picture.colors.rgba, size, &picture.labels, &contours, letters);
}

/// The same of a picture that is not at hand: the pixels that heights stand on, and nothing elsewhere.
pub(crate) fn layer(
    (source, placed): (&dyn SurfaceNodes, &Placed),
    sight: &Sight,
    options: &SurfaceOptions,
    letters: &dyn Letters,
) -> Colors {
    let parts = parts(options.samples);
    let fine = sight.refined(parts);
    let scene = picture::scene(source, placed, sight, options);
    let (seen, _) = picture::visible(&scene, &fine, options, parts);
    let [width, height] = sight.size();
    let colors = Colors { width, height, rgba: vec![[0.0; 4]; width as usize * height as usize] };
    let mut layer = SurfacePicture { colors, ..SurfacePicture::default() };
    write(&mut layer, (source, placed), (&scene, &fine, &seen), options, letters);
    layer.colors
}
