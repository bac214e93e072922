//! Drawings over pictures: an SVG whose unit is one image pixel and whose origin is the centre of the
//! top-left pixel, so that image points are drawn where they are.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::geometry::ImagePoint;

/// A rectangle of the image plane \[px\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

/// A drawing in progress. Line widths and marker sizes are in units of the drawing's `pen`.
pub(super) struct Drawing {
    view: View,
    pen: f64,
    body: String,
}

/// What a marker stands for; each kind has a form and a colour of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Marker {
    /// The detector's position: a yellow square.
    Detected,
    /// The refiner's position: a cyan ring.
    Refined,
    /// The true position: a white cross.
    True,
    /// The grasp point: a yellow star, as in the paper's Figure 5.
    Grasp,
}

impl Drawing {
    /// An empty drawing of `view`, drawn `width_px` wide on a screen.
    pub(super) fn new(view: View, width_px: f64) -> Self {
        Self { view, pen: view.width / width_px, body: String::new() }
    }

    /// Places a PNG so that its pixels' centres are at whole coordinates.
    pub(super) fn picture(&mut self, png: &str, width: u32, height: u32) {
        self.picture_at(png, [0, 0], [width, height]);
    }

    /// Places a PNG that is a part of a picture, whose first pixel is this one of it.
    pub(super) fn picture_at(&mut self, png: &str, first: [u32; 2], [width, height]: [u32; 2]) {
        let [x, y] = first.map(|pixel| f64::from(pixel) - 0.5);
        let _ = write!(
            self.body,
            r#"<image x="{x}" y="{y}" width="{width}" height="{height}" image-rendering="pixelated" href="{png}"/>"#,
        );
    }

    /// A closed outline.
    pub(super) fn outline(&mut self, points: &[ImagePoint], colour: &str) {
        let list: Vec<String> = points.iter().map(|p| format!("{:.4},{:.4}", p.x, p.y)).collect();
        for (stroke, width) in [("#000", 3.2), (colour, 1.6)] {
            let _ = write!(
                self.body,
                r#"<polygon points="{}" fill="none" stroke="{stroke}" stroke-width="{:.4}" stroke-linejoin="round"/>"#,
                list.join(" "),
                width * self.pen,
            );
        }
    }

    /// A thin line.
    pub(super) fn line(&mut self, from: ImagePoint, to: ImagePoint, colour: &str) {
        let _ = write!(
            self.body,
            r#"<line x1="{:.4}" y1="{:.4}" x2="{:.4}" y2="{:.4}" stroke="{colour}" stroke-width="{:.4}"/>"#,
            from.x, from.y, to.x, to.y, self.pen,
        );
    }

    /// A marker.
    pub(super) fn marker(&mut self, at: ImagePoint, marker: Marker) {
        let (size, colour) = match marker {
            Marker::Detected => (5.0, "#ffd400"),
            Marker::Refined => (5.0, "#00e5ff"),
            Marker::True => (7.0, "#fff"),
            Marker::Grasp => (9.0, "#ffd400"),
        };
        let radius = size * self.pen;
        let (x, y) = (at.x, at.y);
        for (stroke, width) in [("#000", 3.4), (colour, 1.7)] {
            let width = width * self.pen;
            let shape = match marker {
                Marker::Detected => format!(
                    r#"<rect x="{:.4}" y="{:.4}" width="{:.4}" height="{:.4}""#,
                    x - radius,
                    y - radius,
                    2.0 * radius,
                    2.0 * radius
                ),
                Marker::Refined => format!(r#"<circle cx="{x:.4}" cy="{y:.4}" r="{radius:.4}""#),
                Marker::True => format!(r#"<path d="{}""#, star(x, y, radius, 2)),
                Marker::Grasp => format!(r#"<path d="{}""#, star(x, y, radius, 4)),
            };
            let _ = write!(
                self.body,
                r#"{shape} fill="none" stroke="{stroke}" stroke-width="{width:.4}"/>"#
            );
        }
    }

    /// The drawing as a file of its own. `title` says in words what it shows.
    pub(super) fn finish(self, title: &str) -> String {
        let View { x, y, width, height } = self.view;
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="{x:.4} {y:.4} {width:.4} {height:.4}" width="{:.0}" height="{:.0}" role="img"><title>{}</title>{}</svg>
"#,
            width / self.pen,
            height / self.pen,
            escaped(title),
            self.body,
        )
    }
}

/// `strokes` strokes through a point: 2 make an upright cross, 4 the paper's star.
fn star(x: f64, y: f64, radius: f64, strokes: u32) -> String {
    (0..strokes)
        .map(|index| {
            let angle = std::f64::consts::PI * f64::from(index) / f64::from(strokes);
            let (dy, dx) = angle.sin_cos();
            let (dx, dy) = (radius * dx, radius * dy);
            format!("M{:.4} {:.4}L{:.4} {:.4}", x - dx, y - dy, x + dx, y + dy)
        })
        .collect()
}

/// A PNG file as a data address.
pub(super) fn png_address(bytes: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(bytes))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_cannot_end_its_element() {
        let view = View { x: 0.0, y: 0.0, width: 1.0, height: 1.0 };
        let text = Drawing::new(view, 10.0).finish("</title><script>");
        assert!(text.contains("&lt;/title&gt;&lt;script&gt;"));
        assert!(!text.contains("<script"));
    }

    #[test]
    fn a_picture_starts_half_a_pixel_before_the_origin() {
        let view = View { x: -0.5, y: -0.5, width: 2.0, height: 2.0 };
        let mut drawing = Drawing::new(view, 10.0);
        drawing.picture("data:,", 2, 2);
        assert!(drawing.finish("t").contains(r#"<image x="-0.5" y="-0.5" width="2""#));
    }
}
