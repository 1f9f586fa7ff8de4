//! Heights along lines in a picture that somebody else draws, with lines all over it: the pixels that heights stand on are shaded once more, without
//! lines, and letters are written over them.

use super::labels::{self, Letters};
use super::photo::PhotoLook;
use super::picture::{self, SurfaceOptions, SurfacePicture, parts};
use super::placed::Placed;
use super::raster::Visibility;
use super::shade::Shader;
use super::sight::Sight;
use super::source::SurfaceNodes;
use super::stitch::Scene;
use crate::color::Colors;

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
