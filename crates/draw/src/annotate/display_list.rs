//! What painters paint: lines, rectangles, colours and words, in logical pixels from the picture's top left corner.

use super::font;

/// A colour: sRGB, gamma-encoded, not premultiplied with its alpha.
pub type Rgba = [u8; 4];

/// A place: to the right, down.
pub type At = [f32; 2];

/// Which point of a text's box stands at its place: 0 is left or top, 1 right or bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor(pub [f32; 2]);

impl Anchor {
    /// The middle of the left side.
    pub const LEFT: Anchor = Anchor([0.0, 0.5]);
    /// The middle of the right side.
    pub const RIGHT: Anchor = Anchor([1.0, 0.5]);
    /// The middle of the upper side.
    pub const TOP: Anchor = Anchor([0.5, 0.0]);
    /// The middle of the lower side.
    pub const BOTTOM: Anchor = Anchor([0.5, 1.0]);
    /// The middle.
    pub const CENTER: Anchor = Anchor([0.5, 0.5]);
    /// The upper left corner.
    pub const LEFT_TOP: Anchor = Anchor([0.0, 0.0]);
    /// The upper right corner.
    pub const RIGHT_TOP: Anchor = Anchor([1.0, 0.0]);
    /// The lower right corner.
    pub const RIGHT_BOTTOM: Anchor = Anchor([1.0, 1.0]);
}

/// Something to paint.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A straight line.
    Line {
        /// One end.
        from: At,
        /// The other.
        to: At,
        /// How thick it is.
        width: f32,
        /// Its colour.
        color: Rgba,
    },
    /// A filled rectangle.
    Rect {
        /// What it covers.
        area: Area,
        /// Its colour.
        color: Rgba,
    },
    /// A circle's line.
    Circle {
        /// Its middle.
        center: At,
        /// Its radius, to the middle of the line.
        radius: f32,
        /// How thick the line is.
        width: f32,
        /// Its colour.
        color: Rgba,
    },
    /// Colours at the corners of a regular grid, interpolated between them.
    Mesh {
        /// What it covers.
        area: Area,
        /// Corners from left to right; two or more.
        columns: usize,
        /// Colours of the corners, row by row from the top; two rows or more.
        colors: Vec<Rgba>,
    },
    /// A line of text, with a dark halo that makes it legible on anything.
    Text {
        /// Where its anchor is.
        at: At,
        /// The point of its box that is there.
        anchor: Anchor,
        /// What it says.
        text: String,
        /// Pixels per em.
        size: f32,
        /// Its colour.
        color: Rgba,
    },
}

/// A rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Upper left corner.
    pub min: At,
    /// Lower right corner.
    pub max: At,
}

impl Area {
    /// The area of a box of that size whose anchor is at a place.
    pub fn anchored(at: At, Anchor(anchor): Anchor, size: [f32; 2]) -> Area {
        let min = [0, 1].map(|k| at[k] - anchor[k] * size[k]);
        Area { min, max: [min[0] + size[0], min[1] + size[1]] }
    }

    /// Larger by `margin` on every side.
    pub fn grown(self, margin: f32) -> Area {
        Area { min: self.min.map(|x| x - margin), max: self.max.map(|x| x + margin) }
    }

    /// Wider by `margin` on the left and on the right.
    pub fn widened(self, margin: f32) -> Area {
        let Area { min: [left, top], max: [right, bottom] } = self;
        Area { min: [left - margin, top], max: [right + margin, bottom] }
    }

    /// Whether both have points in common.
    pub fn overlaps(&self, other: &Area) -> bool {
        (0..2).all(|k| self.min[k] < other.max[k] && other.min[k] < self.max[k])
    }

    /// Whether `other` lies in it.
    pub fn holds(&self, other: &Area) -> bool {
        (0..2).all(|k| self.min[k] <= other.min[k] && other.max[k] <= self.max[k])
    }
}

impl Shape {
    /// The area that it covers, without a text's halo.
    pub fn area(&self) -> Area {
        match self {
            Shape::Line { from, to, width, .. } => {
                Area { min: [0, 1].map(|k| from[k].min(to[k])), max: [0, 1].map(|k| from[k].max(to[k])) }
                    .grown(0.5 * width)
            }
            Shape::Rect { area, .. } | Shape::Mesh { area, .. } => *area,
            Shape::Circle { center, radius, width, .. } => {
                Area { min: *center, max: *center }.grown(radius + 0.5 * width)
            }
            Shape::Text { at, anchor, text, size, .. } => Area::anchored(*at, *anchor, font::extent(text, *size)),
        }
    }
}

/// What to paint, from back to front.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplayList {
    /// Width and height of the picture, logical pixels.
    pub size: [f32; 2],
    /// The shapes.
    pub shapes: Vec<Shape>,
    /// Where other words must not be.
    taken: Vec<Area>,
}

/// Least distance of words in a line; lines may touch, since letters are lower than lines.
const GAP: f32 = 4.0;
/// Least distance of words from the picture's edge.
const MARGIN: f32 = 4.0;

impl DisplayList {
    /// Nothing, in a picture of that size.
    pub fn new(size: [f32; 2]) -> DisplayList {
        DisplayList { size, shapes: Vec::new(), taken: Vec::new() }
    }

    /// The part of the picture where words may be.
    pub fn page(&self) -> Area {
        Area { min: [MARGIN; 2], max: self.size.map(|side| side - MARGIN) }
    }

    /// Adds a line.
    pub fn line(&mut self, from: At, to: At, width: f32, color: Rgba) {
        self.shapes.push(Shape::Line { from, to, width, color });
    }

    /// Adds text that keeps within the picture: it is moved there, and cut where it is too long.
    pub fn text(&mut self, at: At, anchor: Anchor, text: &str, size: f32, color: Rgba) {
        let page = self.page();
        let Some(text) = font::cut(text, size, page.max[0] - page.min[0]) else { return };
        let area = Area::anchored(at, anchor, font::extent(&text, size));
        let shift = [0, 1].map(|k| (page.min[k] - area.min[k]).max(0.0) - (area.max[k] - page.max[k]).max(0.0));
        let at = [at[0] + shift[0], at[1] + shift[1]];
        self.taken.push(Area::anchored(at, anchor, font::extent(&text, size)).widened(GAP));
        self.shapes.push(Shape::Text { at, anchor, text, size, color });
    }

    /// Adds text only where it fits into the picture without touching other words; says whether it did.
    pub fn text_if_free(&mut self, at: At, anchor: Anchor, text: &str, size: f32, color: Rgba) -> bool {
        let area = Area::anchored(at, anchor, font::extent(text, size));
        let free = self.page().holds(&area) && !self.taken.iter().any(|taken| taken.overlaps(&area));
        if free {
            self.taken.push(area.widened(GAP));
            self.shapes.push(Shape::Text { at, anchor, text: text.to_owned(), size, color });
        }
        free
    }

    /// Keeps words that come later out of an area.
    pub fn keep_free(&mut self, area: Area) {
        self.taken.push(area);
    }
}
