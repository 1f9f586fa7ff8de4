//! The raw picture before any transfer function: `P` and `P S` for each pixel.

/// Accumulated `P` and `P S`, row 0 at the top, `width * height` values each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Accumulation {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// `P`: weight per length^2, or per pixel for [`crate::cpu::Extent::Pixels`].
    pub p: Vec<f32>,
    /// `P S`: weight times attribute per length^2. Empty when no batch had an attribute.
    pub ps: Vec<f32>,
}

impl Accumulation {
    /// A black picture, with the `P S` channel or without.
    pub fn new(width: u32, height: u32, attribute: bool) -> Accumulation {
        let pixels = width as usize * height as usize;
        Accumulation { width, height, p: vec![0.0; pixels], ps: vec![0.0; if attribute { pixels } else { 0 }] }
    }

    /// Whether the `P S` channel is there.
    pub fn has_attribute(&self) -> bool {
        !self.ps.is_empty()
    }

    /// Sum of `P` over all pixels, in double precision. In an orthographic view, times the area of a pixel in world
    /// units, this is the weight in view.
    pub fn sum(&self) -> f64 {
        self.p.iter().map(|&p| f64::from(p)).sum()
    }

    /// `S` of a pixel: the weighted mean of the attribute (F12 equation 4.2); `None` where nothing was drawn or no batch
    /// had an attribute.
    pub fn s(&self, index: usize) -> Option<f32> {
        let p = *self.p.get(index)?;
        let ps = *self.ps.get(index)?;
        (p > 0.0).then(|| ps / p)
    }

    /// Relative L1 and L2 distance of `P` from a reference picture of the same size: `sum |p - r| / sum |r|` and
    /// `sqrt(sum (p - r)^2 / sum r^2)`. Two black pictures have distance zero.
    pub fn error_against(&self, reference: &Accumulation) -> (f64, f64) {
        relative_error(&self.p, &reference.p)
    }
}

/// Relative L1 and L2 distance of `values` from `reference`.
pub fn relative_error(values: &[f32], reference: &[f32]) -> (f64, f64) {
    let (mut absolute, mut square, mut absolute_norm, mut square_norm) = (0.0, 0.0, 0.0, 0.0);
    for (&value, &expected) in values.iter().zip(reference) {
        let (difference, expected) = (f64::from(value) - f64::from(expected), f64::from(expected));
        absolute += difference.abs();
        square += difference * difference;
        absolute_norm += expected.abs();
        square_norm += expected * expected;
    }
    let ratio = |error: f64, norm: f64| if error == 0.0 { 0.0 } else { error / norm };
    (ratio(absolute, absolute_norm), ratio(square, square_norm).sqrt())
}
