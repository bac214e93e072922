//! Where a cuboid of known size stands, from where its vertices are seen: perspective n points.
//!
//! Starts are those of a scaled orthographic camera, in closed form: of vertices in space there is one (DeMenthon & Davis,
//! Model-based object pose in 25 lines of code, IJCV 1995), of vertices on one face there are two, mirrored at the plane
//! across the line of sight (Oberkampf, DeMenthon & Davis, Iterative pose estimation using coplanar feature points, CVIU
//! 1996). From each, least squares of the errors in the image over their covariances, by Levenberg and Marquardt, lens
//! included. Collins & Bartoli's IPPE (Infinitesimal plane-based pose estimation, IJCV 2014) has the two of a face from
//! its homography; here as there both are returned, with their errors: which is right the caller may know.

use nalgebra::{
    Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, Rotation3, SMatrix, Translation3, UnitQuaternion,
    Vector2, Vector3, Vector6,
};

use crate::geometry::{Camera, ImagePoint, Pose};

/// A vertex of a cuboid and where it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenVertex {
    /// The sum of 1, 2 and 4 for each of x, y and z along which it is at the end.
    pub vertex: usize,
    /// Where \[px\].
    pub point: ImagePoint,
    /// Of the point \[px^2\].
    pub covariance_px2: Matrix2<f64>,
}

/// A cuboid in the camera's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CuboidPose {
    /// Its middle is the origin, its edges are the axes.
    pub camera_from_cuboid: Pose,
    /// Along its axes \[m\].
    pub size_m: [f64; 3],
    /// Of a turn about the camera's axes through the middle \[rad\], and of a shift along them \[m\].
    pub covariance: Matrix6<f64>,
    /// Squared errors over their covariances, summed.
    pub chi_square: f64,
    /// Root mean square of the distances in the image \[px\].
    pub rmse_px: f64,
}

/// Fewer vertices leave the pose open.
pub const LEAST_VERTICES: usize = 4;
const MOST_ITERATIONS: usize = 60;

impl CuboidPose {
    /// A point that is so far along each axis as shares of the size, in the camera's frame.
    pub fn point(&self, shares: [f64; 3]) -> Point3<f64> {
        self.camera_from_cuboid * local(self.size_m, shares)
    }

    /// A vertex in the camera's frame.
    pub fn vertex(&self, vertex: usize) -> Point3<f64> {
        self.point(shares(vertex))
    }

    /// Root mean square of the distances of its vertices from where they are seen \[px\]; `None` where one is behind the
    /// camera.
    pub fn rmse_px_of(&self, seen: &[SeenVertex], camera: &Camera) -> Option<f64> {
        let square = |one: &SeenVertex| {
            Some(camera.project(&self.vertex(one.vertex))?.distance_px(one.point).powi(2))
        };
        let sum = seen.iter().map(square).sum::<Option<f64>>()?;
        Some((sum / seen.len().max(1) as f64).sqrt())
    }

    /// The same after a small turn and shift.
    #[must_use]
    pub fn changed(&self, change: &Vector6<f64>) -> Self {
        Self { camera_from_cuboid: changed(&self.camera_from_cuboid, change), ..*self }
    }
}

/// The poses that explain where the vertices are seen, the best first: one, or two where they are mirror images that a
/// few pixels cannot tell apart. None of fewer than four vertices, of vertices seen on one line, and of a size of 0.
pub fn poses(seen: &[SeenVertex], size_m: [f64; 3], camera: &Camera) -> Vec<CuboidPose> {
    if seen.len() < LEAST_VERTICES || size_m.iter().any(|size| size.is_nan() || *size <= 0.0) {
        return Vec::new();
    }
    let mut found: Vec<CuboidPose> = Vec::new();
    for start in starts(seen, size_m, camera) {
        let Some(pose) = adjusted(start, seen, size_m, camera) else { continue };
        if found.iter().all(|other| !is_same(other, &pose)) {
            found.push(pose);
        }
    }
    found.sort_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
    found
}

/// The poses for every way in which three lengths may belong to the axes, the best first.
pub fn poses_of_lengths(
    seen: &[SeenVertex],
    lengths_m: [f64; 3],
    camera: &Camera,
) -> Vec<CuboidPose> {
    const ORDERS: [[usize; 3]; 6] =
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let mut tried: Vec<[f64; 3]> = Vec::new();
    for order in ORDERS {
        let size_m = order.map(|axis| lengths_m[axis]);
        if !tried.contains(&size_m) {
            tried.push(size_m);
        }
    }
    let mut found: Vec<CuboidPose> =
        tried.into_iter().flat_map(|size_m| poses(seen, size_m, camera)).collect();
    found.sort_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
    found
}

fn shares(vertex: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(u8::from(vertex & 1 << axis != 0)))
}

fn local(size_m: [f64; 3], shares: [f64; 3]) -> Point3<f64> {
    Point3::from(Vector3::from_fn(|axis, _| (shares[axis] - 0.5) * size_m[axis]))
}

fn changed(pose: &Pose, change: &Vector6<f64>) -> Pose {
    let turn = Rotation3::new(change.fixed_rows::<3>(0).into_owned());
    Pose::from_parts(
        Translation3::from(pose.translation.vector + change.fixed_rows::<3>(3)),
        UnitQuaternion::from_rotation_matrix(&turn) * pose.rotation,
    )
}

fn is_same(a: &CuboidPose, b: &CuboidPose) -> bool {
    let between = a.camera_from_cuboid.inverse() * b.camera_from_cuboid;
    between.rotation.angle() < 1e-3
        && between.translation.vector.norm() < 1e-3 * a.size_m.iter().sum::<f64>()
}

/// The poses that a scaled orthographic camera has that looks at the vertices' middle.
fn starts(seen: &[SeenVertex], size_m: [f64; 3], camera: &Camera) -> Vec<Pose> {
    let count = seen.len() as f64;
    let points: Vec<Vector3<f64>> =
        seen.iter().map(|one| local(size_m, shares(one.vertex)).coords).collect();
    let rays: Vec<Vector3<f64>> = seen.iter().map(|one| camera.ray(one.point)).collect();
    let middle = points.iter().sum::<Vector3<f64>>() / count;
    let sight = rays.iter().map(Vector3::normalize).sum::<Vector3<f64>>();
    let Some(upright) = Rotation3::rotation_between(&Vector3::z(), &sight) else {
        return Vec::new();
    };
    let seen_upright = rays.iter().map(|ray| {
        let ray = upright.inverse() * ray;
        ray.xy() / ray.z
    });
    let seen_upright: Vec<Vector2<f64>> = seen_upright.collect();
    let middle_seen = seen_upright.iter().sum::<Vector2<f64>>() / count;
    // Least squares of seen = M point, over what the points span.
    let mut spread = Matrix3::zeros();
    let mut together = Matrix2x3::zeros();
    for (point, seen) in points.iter().zip(&seen_upright) {
        let point = point - middle;
        spread += point * point.transpose();
        together += (seen - middle_seen) * point.transpose();
    }
    let largest = size_m.iter().fold(0.0_f64, |a, b| a.max(*b));
    let Ok(inverse) = spread.pseudo_inverse(1e-9 * largest * largest) else { return Vec::new() };
    let scaled = together * inverse;
    let rows = [scaled.row(0).transpose(), scaled.row(1).transpose()];
    let is_flat = spread.determinant().abs() < 1e-9 * largest.powi(6);
    let all = if is_flat { flat_rows(rows, &spread) } else { vec![rows] };
    let pose = |[a, b]: [Vector3<f64>; 2]| {
        let turn = upright * rotation(a, b)?;
        let depth_m = 2.0 / (a.norm() + b.norm());
        let there = upright * Vector3::new(middle_seen.x, middle_seen.y, 1.0) * depth_m;
        let rotation = UnitQuaternion::from_rotation_matrix(&turn);
        Some(Pose::from_parts(Translation3::from(there - turn * middle), rotation))
    };
    all.into_iter().filter_map(pose).collect()
}

/// The rotation with two rows nearest to these.
fn rotation(a: Vector3<f64>, b: Vector3<f64>) -> Option<Rotation3<f64>> {
    let (a, b) = (a.try_normalize(1e-12)?, b.try_normalize(1e-12)?);
    let matrix = Matrix3::from_rows(&[a.transpose(), b.transpose(), a.cross(&b).transpose()]);
    let parts = matrix.svd(true, true);
    let turn = parts.u? * parts.v_t?;
    (turn.determinant() > 0.0).then(|| Rotation3::from_matrix_unchecked(turn))
}

/// Of points on a plane M has no part across it; what there is to add makes two rows of the same length at right angles,
/// in two ways.
fn flat_rows([a, b]: [Vector3<f64>; 2], spread: &Matrix3<f64>) -> Vec<[Vector3<f64>; 2]> {
    let eigen = spread.symmetric_eigen();
    let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    // Of a + u n and b + v n: u v = -a.b and u^2 - v^2 = |b|^2 - |a|^2, which is (u + i v)^2.
    let (real, imaginary) = (b.norm_squared() - a.norm_squared(), -2.0 * a.dot(&b));
    let length = real.hypot(imaginary).sqrt();
    let (v, u) = (0.5 * imaginary.atan2(real)).sin_cos();
    [length, -length].map(|by| [a + by * u * normal, b + by * v * normal]).to_vec()
}

/// What a pose leaves: errors in the image, and what moves them.
struct Residuals {
    chi_square: f64,
    square_px2: f64,
    information: Matrix6<f64>,
    right: Vector6<f64>,
}

fn residuals(
    pose: &Pose,
    seen: &[(SeenVertex, Matrix2<f64>)],
    size_m: [f64; 3],
    camera: &Camera,
) -> Option<Residuals> {
    let mut all = Residuals {
        chi_square: 0.0,
        square_px2: 0.0,
        information: Matrix6::zeros(),
        right: Vector6::zeros(),
    };
    for (one, weight) in seen {
        let turned = pose.rotation * local(size_m, shares(one.vertex)).coords;
        let point = Point3::from(turned + pose.translation.vector);
        let here = camera.project(&point)?;
        let error = Vector2::new(one.point.x - here.x, one.point.y - here.y);
        let slope = projection_slope(camera, &point)?;
        let mut jacobian = SMatrix::<f64, 2, 6>::zeros();
        jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&(-slope * turned.cross_matrix()));
        jacobian.fixed_view_mut::<2, 3>(0, 3).copy_from(&slope);
        all.chi_square += (error.transpose() * weight * error)[(0, 0)];
        all.square_px2 += error.norm_squared();
        all.information += jacobian.transpose() * weight * jacobian;
        all.right += jacobian.transpose() * weight * error;
    }
    Some(all)
}

/// How the image of a point moves with it \[px/m\].
fn projection_slope(camera: &Camera, point: &Point3<f64>) -> Option<Matrix2x3<f64>> {
    if point.z <= 0.0 {
        return None;
    }
    let ray = Vector2::new(point.x / point.z, point.y / point.z);
    let lens = camera.distortion.jacobian(ray);
    let focal = Matrix2::new(camera.fx_px, 0.0, 0.0, camera.fy_px);
    let pinhole = Matrix2x3::new(1.0, 0.0, -ray.x, 0.0, 1.0, -ray.y) / point.z;
    Some(focal * lens * pinhole)
}

fn adjusted(
    start: Pose,
    seen: &[SeenVertex],
    size_m: [f64; 3],
    camera: &Camera,
) -> Option<CuboidPose> {
    let seen: Option<Vec<_>> =
        seen.iter().map(|one| Some((*one, one.covariance_px2.try_inverse()?))).collect();
    let seen = seen?;
    let mut pose = start;
    let mut now = residuals(&pose, &seen, size_m, camera)?;
    let mut damping = 1e-3;
    for _ in 0..MOST_ITERATIONS {
        let mut damped = now.information;
        for index in 0..6 {
            damped[(index, index)] *= 1.0 + damping;
        }
        let change = damped.cholesky()?.solve(&now.right);
        let next = changed(&pose, &change);
        match residuals(&next, &seen, size_m, camera) {
            Some(better) if better.chi_square <= now.chi_square => {
                let is_done = change.norm() < 1e-13;
                (pose, now) = (next, better);
                damping = (damping * 0.1_f64).max(1e-12);
                if is_done {
                    break;
                }
            }
            _ if damping > 1e10 => break,
            _ => damping *= 10.0,
        }
    }
    Some(CuboidPose {
        camera_from_cuboid: pose,
        size_m,
        covariance: now.information.cholesky()?.inverse(),
        chi_square: now.chi_square,
        rmse_px: (now.square_px2 / seen.len() as f64).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Distortion;
    use crate::random::Stream;

    const CAMERA: Camera = Camera {
        width: 512,
        height: 512,
        fx_px: 450.0,
        fy_px: 460.0,
        cx_px: 250.0,
        cy_px: 262.0,
        distortion: Distortion { k1: -0.2, k2: 0.05, k3: 0.0, p1: 0.001, p2: -0.0005 },
    };
    const SIZE_M: [f64; 3] = [0.06, 0.09, 0.14];

    fn any_pose(random: &mut Stream) -> Pose {
        let turn = Vector3::from_fn(|_, _| random.normal());
        let at = Vector3::new(
            0.4 * random.uniform() - 0.2,
            0.4 * random.uniform() - 0.2,
            0.6 + random.uniform(),
        );
        Pose::new(at, turn.normalize() * std::f64::consts::PI * random.uniform())
    }

    fn seen(
        pose: &Pose,
        vertices: &[usize],
        noise_px: f64,
        random: &mut Stream,
    ) -> Vec<SeenVertex> {
        let of = |vertex: &usize| {
            let at = CAMERA.project(&(pose * local(SIZE_M, shares(*vertex)))).expect("in front");
            let mut off = || noise_px * random.normal();
            let point = ImagePoint::new(at.x + off(), at.y + off());
            let variance_px2 = noise_px.max(0.1).powi(2);
            SeenVertex {
                vertex: *vertex,
                point,
                covariance_px2: Matrix2::identity() * variance_px2,
            }
        };
        vertices.iter().map(of).collect()
    }

    fn error_of(found: &CuboidPose, pose: &Pose) -> [f64; 2] {
        let between = pose.inverse() * found.camera_from_cuboid;
        [between.rotation.angle(), between.translation.vector.norm()]
    }

    #[test]
    fn vertices_seen_without_error_have_their_cuboid_s_pose() {
        let mut random = Stream::named(&["pose", "exact"]);
        for round in 0..200 {
            let pose = any_pose(&mut random);
            let face = [0, 1, 3, 2];
            for vertices in [&[0, 1, 2, 3, 4, 5, 6][..], &[0, 1, 2, 4], &[1, 3, 2, 7, 5], &face] {
                let found = poses(&seen(&pose, vertices, 0.0, &mut random), SIZE_M, &CAMERA);
                assert!(!found.is_empty() && found.len() <= 2, "{round}: {}", found.len());
                let near = found.iter().map(|one| error_of(one, &pose));
                let near = near.min_by(|a, b| a[0].total_cmp(&b[0])).expect("one");
                assert!(near[0] < 1e-7 && near[1] < 1e-8, "{round} {vertices:?}: {near:?}");
            }
        }
    }

    #[test]
    fn a_face_has_two_poses_and_the_better_one_is_right_without_noise() {
        let mut random = Stream::named(&["pose", "face"]);
        let mut twice = 0;
        for _ in 0..200 {
            let pose = any_pose(&mut random);
            let found = poses(&seen(&pose, &[0, 1, 3, 2], 0.0, &mut random), SIZE_M, &CAMERA);
            assert!(error_of(&found[0], &pose)[0] < 1e-7);
            twice += usize::from(found.len() == 2);
        }
        assert!(twice > 150, "{twice}");
    }

    #[test]
    fn covariances_say_how_far_poses_are_off() {
        let mut random = Stream::named(&["pose", "covariance"]);
        let (mut sum, mut chi_square) = (0.0, 0.0);
        const ROUNDS: usize = 2000;
        for _ in 0..ROUNDS {
            let pose = any_pose(&mut random);
            let seen = seen(&pose, &[0, 1, 2, 3, 4, 5, 6], 0.2, &mut random);
            let found = poses(&seen, SIZE_M, &CAMERA)[0];
            let turn = found.camera_from_cuboid.rotation * pose.rotation.inverse();
            let shift = found.camera_from_cuboid.translation.vector - pose.translation.vector;
            let mut error = Vector6::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&turn.scaled_axis());
            error.fixed_rows_mut::<3>(3).copy_from(&shift);
            let information = found.covariance.try_inverse().expect("definite");
            sum += (error.transpose() * information * error)[(0, 0)];
            chi_square += found.chi_square;
        }
        // Six numbers: mean 6, variance 12 a round; 14 coordinates less 6 are left over.
        let deviation = (12.0 / ROUNDS as f64).sqrt();
        assert!((sum / ROUNDS as f64 - 6.0).abs() < 4.0 * deviation, "{}", sum / ROUNDS as f64);
        let left = chi_square / ROUNDS as f64;
        assert!((left - 8.0).abs() < 4.0 * (16.0 / ROUNDS as f64).sqrt(), "{left}");
    }

    #[test]
    fn lengths_find_their_axes() {
        let mut random = Stream::named(&["pose", "lengths"]);
        for _ in 0..50 {
            let pose = any_pose(&mut random);
            let seen = seen(&pose, &[0, 1, 2, 3, 4, 5, 6], 0.05, &mut random);
            let found = poses_of_lengths(&seen, [SIZE_M[2], SIZE_M[0], SIZE_M[1]], &CAMERA)[0];
            let is_same = |axis: usize| (found.size_m[axis] - SIZE_M[axis]).abs() < 1e-12;
            assert!((0..3).all(is_same), "{:?}", found.size_m);
            assert!(error_of(&found, &pose)[0] < 0.01);
        }
    }

    #[test]
    fn too_little_has_no_pose() {
        let mut random = Stream::named(&["pose", "little"]);
        let pose = any_pose(&mut random);
        let all = seen(&pose, &[0, 1, 2, 4], 0.0, &mut random);
        assert!(poses(&all[..3], SIZE_M, &CAMERA).is_empty());
        assert!(poses(&all, [0.1, 0.0, 0.1], &CAMERA).is_empty());
        let one = [all[0]; 4];
        assert!(poses(&one, SIZE_M, &CAMERA).is_empty());
    }

    #[test]
    fn rows_of_a_face_are_of_one_length_and_at_right_angles() {
        let mut random = Stream::named(&["pose", "rows"]);
        let spread = Matrix3::from_diagonal(&Vector3::new(2.0, 3.0, 0.0));
        for _ in 0..50 {
            let mut row = || Vector3::new(random.normal(), random.normal(), 0.0);
            for [a, b] in flat_rows([row(), row()], &spread) {
                assert!((a.norm() - b.norm()).abs() < 1e-12 && a.dot(&b).abs() < 1e-12, "{a} {b}");
            }
        }
    }
}
