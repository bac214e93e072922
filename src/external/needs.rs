//! What a program is to be given of an exposure, and how samples become its bytes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::sensor::Exposure;

/// What a program needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Needs {
    /// Which planes.
    pub channels: Channels,
    /// What a sample means.
    pub encoding: Meaning,
    /// What a sample is.
    #[serde(rename = "type")]
    pub sample: Sample,
    /// Whether it needs the camera's intrinsics: where nothing knows them it is not run.
    pub intrinsics: bool,
    /// Whether it needs the target's size: where nothing knows it, it is not run.
    pub object_size: bool,
}

/// Which planes of an exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Channels {
    /// One: 0.299 red + 0.587 green + 0.114 blue, rounded to a whole digital number.
    #[default]
    Grey,
    /// Three: red, green, blue, side by side in each pixel.
    Rgb,
}

/// What a sample means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Meaning {
    /// What the camera encoded, its curve and black level left as they are.
    #[default]
    Encoded,
    /// Linear light, 0 at black.
    Linear,
}

/// What a sample is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Sample {
    /// Full scale is 255.
    #[default]
    Uint8,
    /// Full scale is 65535; the machine's byte order.
    Uint16,
    /// Full scale is 1; the machine's byte order.
    Float32,
}

impl Needs {
    /// Refuses what cannot be given.
    ///
    /// # Errors
    /// When linear light is wanted as 8-bit numbers, which are too coarse for it.
    pub(super) fn check(self, place: &str) -> Result<()> {
        if self.encoding == Meaning::Linear && self.sample == Sample::Uint8 {
            return Err(Error::Other(format!(
                "{place}: needs.type is uint8, too coarse for linear light; say \"float32\" or \"uint16\""
            )));
        }
        Ok(())
    }

    /// Samples of a pixel.
    pub fn channels(self) -> usize {
        match self.channels {
            Channels::Grey => 1,
            Channels::Rgb => 3,
        }
    }

    /// Why a program with these needs cannot be shown an exposure; `None` where it can.
    pub fn unmet_by(self, exposure: &Exposure) -> Option<&'static str> {
        if self.intrinsics && exposure.camera().is_none() {
            return Some(
                "it needs the camera's intrinsics, and of this exposure nothing knows them",
            );
        }
        if self.object_size && exposure.object_size_m().is_none() {
            return Some("it needs the target's size, and of this exposure nothing knows it");
        }
        None
    }

    /// The samples of an exposure, row by row, as `bytes`, whose memory is used again.
    pub fn write(self, exposure: &Exposure, bytes: &mut Vec<u8>) {
        bytes.clear();
        #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
        let full = exposure.encoding().full_scale_dn() as f32;
        match self.encoding {
            Meaning::Encoded => self.write_samples(exposure, bytes, |dn| dn / full),
            Meaning::Linear => {
                let light = exposure.linear_light();
                self.write_samples(exposure, bytes, |dn| light.of(dn));
            }
        }
    }

    /// `share` is the share of full scale that a sample \[DN\] stands for.
    fn write_samples(
        self,
        exposure: &Exposure,
        bytes: &mut Vec<u8>,
        share: impl Fn(f32) -> f32 + Copy,
    ) {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "the lowest bits are all that there are"
        )]
        match self.sample {
            Sample::Uint8 => self.fill(exposure, bytes, |dn| [whole(255.0, share(dn)) as u8]),
            Sample::Uint16 => {
                self.fill(exposure, bytes, |dn| (whole(65535.0, share(dn)) as u16).to_ne_bytes());
            }
            Sample::Float32 => self.fill(exposure, bytes, |dn| share(dn).to_ne_bytes()),
        }
    }

    fn fill<const N: usize>(
        self,
        exposure: &Exposure,
        bytes: &mut Vec<u8>,
        of: impl Fn(f32) -> [u8; N],
    ) {
        bytes.resize(exposure.width() * exposure.height() * self.channels() * N, 0);
        let samples = bytes.as_chunks_mut::<N>().0;
        match self.channels {
            Channels::Grey => {
                let from = exposure.luma().samples();
                samples.iter_mut().zip(from).for_each(|(sample, dn)| *sample = of(*dn));
            }
            Channels::Rgb => {
                for (place, plane) in exposure.rgb().iter().enumerate() {
                    let to = samples.iter_mut().skip(place).step_by(3);
                    to.zip(plane.samples()).for_each(|(sample, dn)| *sample = of(*dn));
                }
            }
        }
    }
}

/// The whole number nearest to a share of full scale, halves to even, in the lowest bits. To a float of 2^23 nothing smaller
/// than one can be added: that takes a third of the time of a conversion, which has to care for numbers of any size.
#[inline(always)]
fn whole(full: f32, share: f32) -> u32 {
    const WHOLE: f32 = 8_388_608.0;
    ((full * share).clamp(0.0, full) + WHOLE).to_bits()
}
