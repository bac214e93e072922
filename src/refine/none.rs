//! No refinement: the control of every comparison.
//!
//! ```text
//! # Method      The position is the seed.
//! # Input       none.
//! # Parameters  none.
//! # Output      ok with no iterations; out_of_bounds where a seed is not a finite point.
//! # Border      none.
//! # Cost        O(seeds).
//! # Departures  none.
//! # Source      The paper, Table 1, columns Harris(x) and Harris(y).
//! # Checked by  tests/it/contract.rs (all)
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "none",
    summary: "the detector's own position, unrefined",
    reference: "the paper, Table 1, Harris(x) and Harris(y)",
    version: 1,
    defaults: defaults::<Unrefined>,
    schema: schema::<Unrefined>,
    build: |place, table| Ok(Box::new(parameters::<Unrefined>(place, table)?)),
};

/// The refiner that does nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Unrefined {}

impl Refiner for Unrefined {
    fn refine(&self, _exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let unmoved = |seed: &Detection| {
            let finite = seed.point.x.is_finite() && seed.point.y.is_finite();
            Corner::at_seed(
                *seed,
                0,
                if finite { RefineStatus::Ok } else { RefineStatus::OutOfBounds },
            )
        };
        seeds.iter().map(unmoved).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ImagePoint;
    use crate::image::Plane;
    use crate::sensor::{Encoding, Transfer};

    #[test]
    fn a_seed_is_returned_as_it_is() {
        let plane = Plane::filled(4, 4, 0.0);
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
        let exposure =
            Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite");
        let seed = Detection::new(ImagePoint::new(2.0, 1.0), 7.0);
        let corners = Unrefined::default().refine(&exposure, &[seed]);
        assert_eq!(corners, [Corner::at_seed(seed, 0, RefineStatus::Ok)]);
        assert_eq!(corners[0].position, seed.point);
    }
}
