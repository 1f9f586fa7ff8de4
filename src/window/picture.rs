//! The picture: the image that the data is drawn into, the camera that draws it, and where it stands in the window.
//!
//! Whoever draws, GPU passes of the data camera or the processor, draws into one [`Image`]; the window shows it in the
//! space that the panel leaves free. So the middle of the picture is the middle of what one sees, with and without
//! the panel, and both kinds of backend share everything else.

use super::camera::{Anchor, Fly, Navigation, Viewpoint};
use super::preset::Preset;
use super::statistics::ActiveBackend;
use crate::color::Image as Colors;
use bevy::asset::RenderAssetUsages;
use bevy::camera::{RenderTarget, visibility::RenderLayers};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::image::ImageSampler;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureUsages};
use bevy_egui::{EguiGlobalSettings, EguiTextureHandle, EguiUserTextures, PrimaryEguiContext, egui};
use bevy_panorbit_camera::{ActiveCameraData, PanOrbitCamera};

/// The picture's image and its place in the window.
#[derive(Resource, Debug)]
pub struct Picture {
    /// What is drawn into: `Rgba8UnormSrgb`, [`Picture::size`] pixels.
    pub image: Handle<Image>,
    /// The image as egui knows it.
    pub texture: egui::TextureId,
    /// Place in the window, logical pixels.
    pub rect: Rect,
    /// Physical pixels per logical pixel.
    pub scale: f32,
    /// Whether the window has laid out its place; before, that is the whole window.
    pub is_placed: bool,
}

impl Picture {
    /// Size in physical pixels; at least 1x1.
    pub fn size(&self) -> UVec2 {
        (self.rect.size() * self.scale).round().as_uvec2().clamp(UVec2::ONE, UVec2::splat(16384))
    }

    /// A picture at a place that has been laid out.
    #[cfg(test)]
    pub(crate) fn at(rect: Rect) -> Picture {
        Picture { image: Handle::default(), texture: egui::TextureId::default(), rect, scale: 1.0, is_placed: true }
    }

    /// Pixel coordinates in the picture of a place in the window (logical pixels).
    pub fn pixel(&self, window: Vec2) -> Vec2 {
        (window - self.rect.min) * self.scale
    }
}

/// Width and height of a picture that has a shape of its own, pixels: it stands in the middle of its place, as large as it fits, with
/// black around it. Without, a picture fills its place.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Letterbox(pub Option<UVec2>);

impl Letterbox {
    /// Where the picture stands in a place, logical pixels, of which each is `scale` physical ones. What fits exactly is not resampled.
    pub fn within(&self, place: Rect, scale: f32) -> Rect {
        let Some(shape) = self.0.map(|size| size.max(UVec2::ONE).as_vec2()) else { return place };
        let room = (place.size() * scale).round();
        let size = (shape * (room / shape).min_element()).round().min(room);
        let corner = place.min + ((room - size) / 2.0).floor() / scale;
        Rect::from_corners(corner, corner + size / scale)
    }
}

/// Marks the camera that looks at the data.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct DataCamera;

/// An empty picture image of that size.
fn picture_image(size: UVec2) -> Image {
    let mut image = Image::new_fill(
        Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        TextureDimension::D2,
        &[0, 0, 0, 255],
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::default(),
    );
    image.texture_descriptor.usage = TextureUsages::TEXTURE_BINDING
        | TextureUsages::COPY_DST
        | TextureUsages::COPY_SRC
        | TextureUsages::RENDER_ATTACHMENT;
    image.sampler = ImageSampler::nearest();
    image
}

/// Colours as an image that egui shows; smoothed where it is stretched.
pub(super) fn to_image(colors: Colors) -> Image {
    let size = Extent3d { width: colors.width, height: colors.height, depth_or_array_layers: 1 };
    let bytes = bytemuck::allocation::cast_vec::<[u8; 4], u8>(colors.rgba);
    let mut image =
        Image::new(size, TextureDimension::D2, bytes, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::default());
    image.sampler = ImageSampler::linear();
    image
}

/// Makes the picture, the data camera that draws it, and the camera of the panel.
pub(super) fn spawn_cameras(
    mut commands: Commands,
    mut images: ResMut<Assets<Image>>,
    mut textures: ResMut<EguiUserTextures>,
    mut egui_settings: ResMut<EguiGlobalSettings>,
    preset: Res<Preset>,
) {
    egui_settings.auto_create_primary_context = false;
    let size = UVec2::new(preset.window.width, preset.window.height);
    let image = images.add(picture_image(size));
    let texture = textures.add_image(EguiTextureHandle::Strong(image.clone()));
    let fov_y = preset.camera.field_of_view_deg.to_radians();
    let viewpoint = Viewpoint { eye: DVec3::new(0.35, 0.3, 1.0) * 3.0, target: DVec3::ZERO, up: DVec3::Y, fov_y };
    let mut orbit = PanOrbitCamera::default();
    let anchor = Anchor::default().adopt(&viewpoint, &mut orbit);
    let data_camera = commands
        .spawn((
            DataCamera,
            Camera3d::default(),
            // Switched on where the GPU draws; it would clear what the processor has drawn.
            Camera { order: -1, is_active: false, clear_color: ClearColorConfig::Custom(Color::BLACK), ..default() },
            RenderTarget::Image(image.clone().into()),
            Projection::Perspective(PerspectiveProjection { fov: fov_y as f32, ..default() }),
            Msaa::Off,
            Tonemapping::None,
            orbit,
            (anchor, viewpoint, Navigation::Orbit, Fly::default()),
        ))
        .id();
    commands.spawn((
        PrimaryEguiContext,
        Camera2d,
        RenderLayers::none(),
        Camera { clear_color: ClearColorConfig::Custom(Color::BLACK), ..default() },
        Msaa::Off,
        Tonemapping::None,
    ));
    commands.insert_resource(Picture {
        image,
        texture,
        rect: Rect::from_corners(Vec2::ZERO, size.as_vec2()),
        scale: 1.0,
        is_placed: false,
    });
    commands.insert_resource(ActiveCameraData { entity: Some(data_camera), manual: true, ..default() });
}

/// Fits the image to its place in the window, and tells the orbit camera how large that is.
pub(super) fn fit_picture(
    picture: Res<Picture>,
    backend: Res<ActiveBackend>,
    mut images: ResMut<Assets<Image>>,
    mut letterbox: ResMut<Letterbox>,
    mut active: ResMut<ActiveCameraData>,
) {
    let size = picture.size();
    // The processor brings images of its own sizes.
    let fits = |image: &Image| {
        image.size() == size && image.texture_descriptor.usage.contains(TextureUsages::RENDER_ATTACHMENT)
    };
    if backend.is_on_adapter() && !images.get(&picture.image).is_some_and(fits) {
        letterbox.0 = None;
        // The image is replaced in place, so that the camera and egui keep their handles.
        if images.insert(&picture.image, picture_image(size)).is_err() {
            warn!("the picture's image is gone");
        }
    }
    let logical = picture.rect.size().max(Vec2::ONE);
    active.viewport_size = Some(logical);
    active.window_size = Some(logical);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_places_become_physical_pixels() {
        let picture = Picture { scale: 2.0, ..Picture::at(Rect::new(300.0, 0.0, 1280.0, 720.0)) };
        assert_eq!(picture.size(), UVec2::new(1960, 1440));
        assert_eq!(picture.pixel(Vec2::new(310.0, 5.0)), Vec2::new(20.0, 10.0));
    }

    #[test]
    fn a_picture_with_a_shape_of_its_own_stands_in_the_middle() {
        let place = Rect::new(300.0, 0.0, 1281.0, 720.0);
        let within = |size: Option<[u32; 2]>, scale| Letterbox(size.map(UVec2::from)).within(place, scale);
        assert_eq!(within(None, 2.0), place);
        // Pixel on pixel where it fits, and as large where it is smaller.
        for side in [720, 180, 90] {
            assert_eq!(within(Some([side; 2]), 1.0), Rect::new(430.0, 0.0, 1150.0, 720.0), "{side}");
        }
        assert_eq!(within(Some([1440; 2]), 2.0), Rect::new(430.5, 0.0, 1150.5, 720.0));
        assert_eq!(within(Some([980, 490]), 1.0), Rect::new(300.0, 114.0, 1281.0, 605.0));
    }
}
