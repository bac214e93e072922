//! The camera: what its data sheet says comes out of its pictures.

use cornerbench::geometry::{Camera, Distortion};
use cornerbench::image::Plane;
use cornerbench::scene::Film;

mod distortion;
mod noise;
mod peers;
mod phase;
mod program;

fn pinhole(width: u32, height: u32) -> Camera {
    Camera {
        width,
        height,
        fx_px: 400.0,
        fy_px: 400.0,
        cx_px: 0.5 * f64::from(width - 1),
        cy_px: 0.5 * f64::from(height - 1),
        distortion: Distortion::NONE,
    }
}

fn flat(camera: &Camera, radiance: f32) -> Film {
    let plane = Plane::filled(camera.width as usize, camera.height as usize, radiance);
    Film { oversampling: 1, radiance: [plane.clone(), plane.clone(), plane] }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
