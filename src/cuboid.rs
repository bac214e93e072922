//! A cuboid as one camera sees it, of unknown size: what its picture depends on, and what is seen of it.

use nalgebra::{Matrix2, Point3, Rotation3, SMatrix, SVector, Vector3};

use crate::geometry::{Camera, ImagePoint};

/// So many numbers determine the picture: a turn, where one vertex is seen, three lengths.
pub const FREEDOM: usize = 8;

/// A change of a cuboid: turn about x, y, z \[rad\], its first vertex along x and y, logarithms of its lengths.
pub type Change = SVector<f64, FREEDOM>;

/// What is known about a change: Fisher's information, or its inverse.
pub type Information = SMatrix<f64, FREEDOM, FREEDOM>;

/// A cuboid in the camera's frame. Its size is known up to a factor: its first vertex is at depth 1.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid {
    /// Its axes, as columns, away from the first vertex.
    pub axes: [Vector3<f64>; 3],
    /// The first vertex, at z = 1.
    pub first: Vector3<f64>,
    /// Along each axis.
    pub lengths: [f64; 3],
    /// Whether something tells each length: edges at an end that nobody knows are not looked for.
    pub is_known: [bool; 3],
}

/// One of the twelve edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// The axis it is parallel to.
    pub axis: usize,
    /// The vertex it starts at; a vertex is the sum of 1, 2 and 4 for each axis it lies along.
    pub from: usize,
}

/// All edges.
pub fn edges() -> impl Iterator<Item = Edge> {
    (0..3).flat_map(|axis| {
        (0..8).filter(move |from| from & 1 << axis == 0).map(move |from| Edge { axis, from })
    })
}

impl Cuboid {
    /// A vertex, or a point that is so far along each axis, as shares of the lengths.
    pub fn point(&self, shares: [f64; 3]) -> Vector3<f64> {
        (0..3).fold(self.first, |sum, i| sum + shares[i] * self.lengths[i] * self.axes[i])
    }

    /// How far a vertex is along each axis: 0 or 1.
    pub fn shares(vertex: usize) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(u8::from(vertex & 1 << axis != 0)))
    }

    /// Where a vertex is seen; `None` where it is behind the camera.
    pub fn vertex(&self, vertex: usize, camera: &Camera) -> Option<ImagePoint> {
        camera.project(&Point3::from(self.point(Self::shares(vertex))))
    }

    /// Where a point of an edge is seen, so far along it as a share.
    pub fn on_edge(&self, edge: Edge, share: f64, camera: &Camera) -> Option<ImagePoint> {
        let mut shares = Self::shares(edge.from);
        shares[edge.axis] = share;
        camera.project(&Point3::from(self.point(shares)))
    }

    /// Whether the face across an axis, at its start or its end, looks at the camera.
    pub fn faces(&self, axis: usize, is_end: bool) -> bool {
        let along = self.axes[axis].dot(&self.first);
        if is_end { along + self.lengths[axis] < 0.0 } else { along > 0.0 }
    }

    /// Whether an edge is where it is known to be, and bounds a face that looks at the camera: if nothing else
    /// hides it, it is seen.
    pub fn shows(&self, edge: Edge) -> bool {
        let others = || (0..3).filter(|axis| *axis != edge.axis);
        let is_end = |axis: usize| edge.from & 1 << axis != 0;
        others().all(|axis| self.is_known[axis] || !is_end(axis))
            && others().any(|axis| self.faces(axis, is_end(axis)))
    }

    /// Whether a vertex is where it is known to be, and belongs to a face that looks at the camera.
    pub fn shows_vertex(&self, vertex: usize) -> bool {
        let is_end = |axis: usize| vertex & 1 << axis != 0;
        (0..3).all(|axis| self.is_known[axis] || !is_end(axis))
            && (0..3).any(|axis| self.faces(axis, is_end(axis)))
    }

    /// The directions in the image in which the edges leave a vertex that are seen \[rad\].
    pub fn rays(&self, vertex: usize, camera: &Camera) -> impl Iterator<Item = f64> {
        let here = self.vertex(vertex, camera);
        (0..3).filter_map(move |axis| {
            let edge = Edge { axis, from: vertex & !(1 << axis) };
            let share = if edge.from == vertex { 0.05 } else { 0.95 };
            let (here, there) = (here?, self.on_edge(edge, share, camera)?);
            self.shows(edge).then(|| (there.y - here.y).atan2(there.x - here.x))
        })
    }

    /// It, changed a little.
    #[must_use]
    pub fn changed(&self, change: &Change) -> Self {
        let turn = Rotation3::new(Vector3::new(change[0], change[1], change[2]));
        let mut lengths = self.lengths;
        for (axis, length) in lengths.iter_mut().enumerate() {
            *length *= change[5 + axis].exp();
        }
        Self {
            axes: self.axes.map(|axis| turn * axis),
            first: self.first + Vector3::new(change[3], change[4], 0.0),
            lengths,
            ..*self
        }
    }

    /// What a place in the image does as the cuboid changes: derivatives of its x and y; `None` where it is not
    /// in front of the camera.
    pub fn derivatives(&self, place: impl Fn(&Self) -> Option<ImagePoint>) -> Option<[Change; 2]> {
        const STEP: f64 = 1e-6;
        let mut of = [Change::zeros(); 2];
        for index in 0..FREEDOM {
            let mut step = Change::zeros();
            step[index] = STEP;
            let (more, less) = (place(&self.changed(&step))?, place(&self.changed(&-step))?);
            of[0][index] = (more.x - less.x) / (2.0 * STEP);
            of[1][index] = (more.y - less.y) / (2.0 * STEP);
        }
        Some(of)
    }

    /// The share of an edge's length in space at a share of its length in the image, where it is foreshortened.
    pub fn share_in_space(&self, edge: Edge, image_share: f64) -> f64 {
        let depth = |end: f64| {
            let mut shares = Self::shares(edge.from);
            shares[edge.axis] = end;
            self.point(shares).z
        };
        let (start, end) = (depth(0.0), depth(1.0));
        image_share * start / (end + image_share * (start - end))
    }

    /// The covariance of where a vertex is seen, by that of a change \[px^2\].
    pub fn vertex_covariance_px2(
        &self,
        vertex: usize,
        camera: &Camera,
        covariance: &Information,
    ) -> Option<Matrix2<f64>> {
        let [x, y] = self.derivatives(|cuboid| cuboid.vertex(vertex, camera))?;
        let of = |a: &Change, b: &Change| (a.transpose() * covariance * b)[(0, 0)];
        Some(Matrix2::new(of(&x, &x), of(&x, &y), of(&y, &x), of(&y, &y)))
    }
}
