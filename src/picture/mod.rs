//! Pictures of one's own: files that some camera wrote, and the corners that somebody knows in them.
//!
//! | file | samples | taken as |
//! |---|---|---|
//! | PNG, TIFF, BMP, JPEG | 8 or 16 bits, grey or colour | sRGB |
//! | TIFF, OpenEXR | float, grey or colour; OpenEXR's half float and uint, too | linear light |
//!
//! No sample loses bits. Alpha is left out. What EXIF says of a picture's orientation is obeyed, as OpenCV and viewers
//! do it; so corners are counted in the picture as it is shown.

mod known;
mod samples;
mod score;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::image::Plane;
use crate::sensor::{Encoding, Exposure, Photographer, Transfer};

pub use crate::geometry::Origin;
pub use known::{KnownCorner, KnownCorners};
pub use score::{
    Agreeing, Agreement, Located, Score, Spread, agreement, deviation_px, likely_origin, score,
};

/// The names of pictures end in one of these, in small letters or capitals.
pub const EXTENSIONS: [&str; 7] = ["bmp", "exr", "jpeg", "jpg", "png", "tif", "tiff"];

/// Larger pictures are refused before they are decoded \[px\].
pub const MOST_PIXELS: u64 = 1 << 28;

/// Floats become samples of so many bits; they are not rounded.
const FLOAT_BITS: u8 = 16;

/// What is known of how a picture came to be; nothing by default.
#[derive(Clone, Copy, Debug, Default)]
pub struct Making<'a> {
    /// The camera that took it. Then curve, black level, noise and mosaic are its own.
    pub camera: Option<&'a Photographer>,
    /// The curve from light to samples, where no camera says so.
    pub transfer: Option<Transfer>,
    /// Of linear floats the value of full scale, where they are saturated; without it just above the brightest.
    pub white: Option<f64>,
}

/// Reads a picture, without loss of bits.
///
/// # Errors
/// When the file cannot be read, is no picture, has more than [`MOST_PIXELS`] or samples that are not finite, or does
/// not fit what is known of it: other bits than the camera's, say.
pub fn read_picture(path: &Path, making: &Making) -> Result<Exposure> {
    let samples = samples::decode(path)?;
    let exposure = match (making.camera, samples.bits) {
        (Some(camera), bits) => {
            let rgb = of_camera(camera, samples.rgb, bits, samples.is_turned);
            rgb.and_then(|rgb| camera.exposure_of(rgb))
        }
        (None, Some(bit_depth)) => {
            let transfer = making.transfer.unwrap_or(Transfer::Srgb);
            Exposure::new(samples.rgb, Encoding { bit_depth, transfer, black_dn: 0.0 })
        }
        (None, None) => of_floats(samples.rgb, making),
    };
    exposure.map_err(|error| Error::malformed(path, error))
}

/// The samples of a file as numbers of the camera that is said to have written it.
fn of_camera(
    camera: &Photographer,
    mut rgb: [Plane<f32>; 3],
    bits: Option<u8>,
    is_turned: bool,
) -> Result<[Plane<f32>; 3]> {
    let wanted = camera.model().output.bit_depth;
    let refuse = |found: String| {
        let name = camera.name();
        Err(Error::Other(format!(
            "{found}, camera {name} gives {wanted} bits; try another --camera, or --transfer"
        )))
    };
    let Some(bits) = bits else { return refuse("its samples are floats".into()) };
    if bits < wanted || (wanted == 8 && bits > 8) {
        return refuse(format!("its samples have {bits} bits"));
    }
    if is_turned && camera.has_mosaic() {
        let problem =
            "its EXIF orientation turns it, so the place of the camera's mosaic is not known";
        return Err(Error::Other(format!(
            "{problem}; turn it by a program first, or leave out --camera"
        )));
    }
    #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
    let full = (2.0_f64.powi(wanted.into()) - 1.0) as f32;
    let samples = || rgb.iter().flat_map(Plane::samples);
    let largest = samples().copied().fold(0.0, f32::max);
    if largest > full {
        // Fewer bits than the file's may stand at its upper end.
        let step = f32::from(1_u16 << (bits - wanted));
        if samples().any(|sample| sample % step != 0.0) {
            return refuse(format!(
                "its largest sample is {largest}, which is neither at most {full} nor are all samples multiples of {step}"
            ));
        }
        for sample in rgb.iter_mut().flat_map(Plane::samples_mut) {
            *sample /= step;
        }
    }
    Ok(rgb)
}

/// Floats as samples of [`FLOAT_BITS`]; below zero there is room, as of a black level.
fn of_floats(mut rgb: [Plane<f32>; 3], making: &Making) -> Result<Exposure> {
    let transfer = making.transfer.unwrap_or(Transfer::Linear);
    let samples = || rgb.iter().flat_map(Plane::samples).map(|sample| f64::from(*sample));
    if !samples().all(f64::is_finite) {
        // It says which one.
        return Exposure::new(rgb, Encoding { bit_depth: FLOAT_BITS, transfer, black_dn: 0.0 });
    }
    let (least, most) =
        samples().fold((0.0, 0.0), |(least, most), sample| (sample.min(least), sample.max(most)));
    if transfer != Transfer::Linear && (least < 0.0 || most > 1.0) {
        let found = if least < 0.0 { least } else { most };
        let problem = format!("a sample is {found}; floats of a curve must be in [0, 1]");
        return Err(Error::Other(format!("{problem}; --transfer linear takes others")));
    }
    let full_scale_dn = 2.0_f64.powi(FLOAT_BITS.into()) - 1.0;
    let white = match (transfer, making.white) {
        (Transfer::Linear, Some(white)) => white,
        (Transfer::Linear, None) if most > 0.0 => most * (1.0 + 1.0 / full_scale_dn),
        _ => 1.0,
    };
    let dn_per_unit = full_scale_dn / (white - least);
    #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
    for sample in rgb.iter_mut().flat_map(Plane::samples_mut) {
        *sample = (dn_per_unit * (f64::from(*sample) - least)).min(full_scale_dn) as f32;
    }
    let black_dn = -least * dn_per_unit;
    Exposure::new(rgb, Encoding { bit_depth: FLOAT_BITS, transfer, black_dn })
}

/// The pictures in a folder, not in folders within it, sorted by name; those whose names begin with a dot are left out.
///
/// # Errors
/// When the folder cannot be read, or holds none.
pub fn find_pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder, "read"))? {
        let path = entry.map_err(Error::io(folder, "read"))?.path();
        let is_hidden =
            path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        let extension = path.extension().map(OsStr::to_ascii_lowercase).unwrap_or_default();
        if !is_hidden && EXTENSIONS.iter().any(|one| extension == *one) && path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    if found.is_empty() {
        let problem =
            format!("no picture is here; the name of one ends in .{}", EXTENSIONS.join(", ."));
        return Err(Error::malformed(folder, problem));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{CameraModel, Colour, Curve, Output};

    fn plane(samples: &[f32]) -> [Plane<f32>; 3] {
        let plane = Plane::from_samples(samples.len(), 1, samples.to_vec());
        [plane.clone(), plane.clone(), plane]
    }

    #[test]
    fn linear_floats_keep_their_ratios_and_what_is_below_zero() {
        let exposure =
            of_floats(plane(&[-0.5, 0.0, 1.5, 3.0]), &Making::default()).expect("finite");
        let light = exposure.linear_light();
        let lights: Vec<f32> = exposure.rgb()[0].samples().iter().map(|dn| light.of(*dn)).collect();
        assert!((lights[2] / lights[3] - 0.5).abs() < 1e-5, "{lights:?}");
        assert!((lights[0] / lights[3] + 1.0 / 6.0).abs() < 1e-5, "{lights:?}");
        assert!(lights[1].abs() < 1e-6 && lights[3] < 1.0, "{lights:?}");
        assert!(!exposure.saturated().samples().contains(&true));
    }

    #[test]
    fn a_given_white_saturates() {
        let making = Making { white: Some(1.0), ..Making::default() };
        let exposure = of_floats(plane(&[0.25, 1.0, 7.0]), &making).expect("finite");
        assert_eq!(exposure.saturated().samples(), [false, true, true]);
        assert!((exposure.rgb()[0].at(0, 0) - 16383.75).abs() < 1e-2);
    }

    #[test]
    fn floats_that_no_curve_gives_are_refused() {
        let making = Making { transfer: Some(Transfer::Srgb), ..Making::default() };
        let error = of_floats(plane(&[0.5, 1.5]), &making).expect_err("beyond 1").to_string();
        assert!(error.contains("a sample is 1.5") && error.contains("[0, 1]"), "{error}");
    }

    #[test]
    fn floats_without_light_or_far_from_one_are_no_failure() {
        for samples in [[0.0; 2], [-1.0, -2.0], [f32::MAX, f32::MIN], [1e-40, 0.0]] {
            let exposure = of_floats(plane(&samples), &Making::default()).expect("finite");
            assert!(exposure.rgb()[0].samples().iter().all(|dn| (0.0..=65535.0).contains(dn)));
        }
        assert!(of_floats(plane(&[f32::NAN]), &Making::default()).is_err());
        assert!(of_floats(plane(&[f32::INFINITY, 0.0]), &Making::default()).is_err());
    }

    fn camera(bit_depth: u8) -> Photographer {
        let output = Output { bit_depth, transfer: Curve::Linear, ..Output::default() };
        let model = CameraModel { output, colour: Colour::Mono, ..CameraModel::default() };
        Photographer::new("mine", &model, None)
    }

    #[test]
    fn samples_of_fewer_bits_may_stand_at_either_end_of_sixteen() {
        let twelve = camera(12);
        for samples in [[16.0, 4095.0], [256.0, 65520.0]] {
            let rgb = of_camera(&twelve, plane(&samples), Some(16), false).expect("twelve bits");
            assert_eq!(rgb[0].samples(), [16.0, 4095.0]);
        }
        let error = of_camera(&twelve, plane(&[17.0, 4096.0]), Some(16), false);
        let error = error.expect_err("thirteen bits").to_string();
        assert!(
            error.contains("4096") && error.contains("4095") && error.contains("12 bits"),
            "{error}"
        );
        for (camera, bits) in [(&twelve, Some(8)), (&twelve, None), (&camera(8), Some(16))] {
            assert!(of_camera(camera, plane(&[1.0]), bits, false).is_err(), "{bits:?}");
        }
    }

    #[test]
    fn pictures_of_a_folder_are_sorted_and_hidden_ones_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let error = find_pictures(folder.path()).expect_err("none").to_string();
        assert!(error.contains("no picture is here") && error.contains(".tiff"), "{error}");
        for name in ["b.PNG", "a.tif", ".c.png", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").expect("written");
        }
        std::fs::create_dir(folder.path().join("d.png")).expect("made");
        let found = find_pictures(folder.path()).expect("two");
        let names: Vec<_> = found.iter().filter_map(|path| path.file_name()?.to_str()).collect();
        assert_eq!(names, ["a.tif", "b.PNG"]);
    }
}
