//! Drawn junctions as images of a plan: closed form, exact, any number of them.
//!
//! A cell is a kind of junction and how it is photographed. Each combination of the values of a `[[drawn]]` table
//! is a cell.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Table;

use super::alternatives;
use crate::error::{Error, Result};
use crate::junction::Junction;
use crate::junction::rays::MOST_RAYS;
use crate::registry;

/// Junctions of one kind, in any orientation and phase, and what is between them and the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Its name: the kind, then all that differs between the cells of the plan's table.
    pub name: String,
    /// What sets it apart.
    pub factors: Factors,
    /// Which of the plan's tables it stands in.
    pub table: usize,
    /// What that table gives.
    pub given: Table,
}

/// What sets a cell of drawn junctions apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Cell")]
pub struct Factors {
    /// What they look like: L, Y, arrow, T (an outline before an edge) or X (two squares of a board).
    pub junction: Kind,
    /// Angle between the first two edges \[degrees\]: of an L its opening, of a Y one of three, of an arrow both, of a T
    /// that of the edge behind against the outline, of an X that of its two lines. 90; of a Y 120, of an arrow 60.
    #[schemars(range(min = 5.0, max = 175.0))]
    pub angle_deg: Option<f64>,
    /// What they are of: "grey", or "red", of which the blue and green light is a fifth.
    pub surface: Surface,
    /// Instead of the camera's: standard deviation of a Gaussian blur \[px\].
    #[schemars(range(min = 0.0, max = 8.0))]
    pub gaussian_sigma_px: Option<f64>,
    /// Instead of the camera's: radius of the disc of a point out of focus \[px\].
    #[schemars(range(min = 0.0, max = 16.0))]
    pub defocus_radius_px: Option<f64>,
    /// Instead of the camera's: radius of the first dark ring of the diffraction pattern \[px\].
    #[schemars(range(min = 0.0, max = 8.0))]
    pub airy_radius_px: Option<f64>,
    /// Instead of the camera's: length of a uniform straight motion during the exposure \[px\].
    #[schemars(range(min = 0.0, max = 16.0))]
    pub motion_length_px: Option<f64>,
    /// The largest difference of levels over the read noise, which takes the place of the sensor's.
    #[schemars(range(min = 0.1, max = 1e6))]
    pub contrast_over_noise: Option<f64>,
    /// How much brighter each sector becomes in a direction at random, as a share of that difference \[1/px\].
    #[schemars(range(min = 0.0, max = 0.1))]
    pub ramp_per_px: f64,
    /// Along the first edge so far away is another corner: the surface is a strip of that width \[px\]. Of an L.
    #[schemars(range(min = 1.0, max = 100.0))]
    pub neighbour_px: Option<f64>,
    /// Radius of the circle that rounds the corner \[px\]; the true corner is where its edges would meet. Of an L.
    #[schemars(range(min = 0.0, max = 16.0))]
    pub rounding_px: f64,
    /// How many, each turned and placed at random.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub corners: u32,
    /// Instead of places at random: a grid of so many by so many places in a pixel.
    #[schemars(range(min = 1, max = 256))]
    pub phase_grid: Option<u32>,
    /// Instead of turns at random: so many, evenly spread; at each every place of the grid.
    #[schemars(range(min = 1, max = 10_000))]
    pub turns: Option<u32>,
}

/// Kinds of junctions that can be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Kind {
    /// A surface before another.
    L,
    /// Three surfaces, less than half a turn each.
    Y,
    /// Two surfaces before a third.
    #[serde(rename = "arrow")]
    Arrow,
    /// An outline before an edge.
    T,
    /// Two and two alike.
    X,
}

/// What junctions are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Surface {
    /// All colours alike.
    Grey,
    /// Little green and blue light.
    Red,
}

impl Surface {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Red => "red",
        }
    }

    /// Shares of the levels in red, green and blue.
    pub fn shares(self) -> [f32; 3] {
        match self {
            Self::Grey => [1.0; 3],
            Self::Red => [1.0, 0.2, 0.2],
        }
    }
}

impl Cell {
    /// Its name and what sets it apart, for run.json.
    pub fn description(&self) -> serde_json::Value {
        serde_json::json!({
            "name": self.name,
            "table": self.table,
            "given": self.given,
            "factors": self.factors,
        })
    }
}

impl Default for Factors {
    fn default() -> Self {
        Self {
            junction: Kind::L,
            angle_deg: None,
            surface: Surface::Grey,
            gaussian_sigma_px: None,
            defocus_radius_px: None,
            airy_radius_px: None,
            motion_length_px: None,
            contrast_over_noise: None,
            ramp_per_px: 0.0,
            neighbour_px: None,
            rounding_px: 0.0,
            corners: 2500,
            phase_grid: None,
            turns: None,
        }
    }
}

impl Kind {
    /// What truth and records call it.
    pub fn junction(self) -> Junction {
        match self {
            Self::L => Junction::L,
            Self::Y => Junction::Y,
            Self::Arrow => Junction::Arrow,
            Self::T => Junction::T,
            Self::X => Junction::X,
        }
    }

    /// Light of its sectors, from the first edge on; of an X the third is as the first, the fourth as the second.
    pub fn levels(self) -> [f64; MOST_RAYS] {
        match self {
            Self::L | Self::X => [0.8, 0.2, 0.0],
            Self::Y => [0.8, 0.5, 0.3],
            Self::Arrow => [0.9, 0.5, 0.15],
            Self::T => [0.5, 0.2, 0.8],
        }
    }
}

impl Factors {
    /// The angle between the first two edges \[degrees\].
    pub fn angle_deg(&self) -> f64 {
        self.angle_deg.unwrap_or(match self.junction {
            Kind::L | Kind::T | Kind::X => 90.0,
            Kind::Y => 120.0,
            Kind::Arrow => 60.0,
        })
    }

    /// Directions of the edges from the first on \[degrees\], ascending; of an X its first two.
    pub fn directions_deg(&self) -> Vec<f64> {
        let angle_deg = self.angle_deg();
        match self.junction {
            Kind::L | Kind::X => vec![0.0, angle_deg],
            Kind::Y => vec![0.0, angle_deg, 0.5 * (360.0 + angle_deg)],
            Kind::Arrow => vec![0.0, angle_deg, 2.0 * angle_deg],
            Kind::T => vec![0.0, angle_deg, 180.0],
        }
    }

    /// The largest difference of levels.
    pub fn contrast(&self) -> f64 {
        let levels = &self.junction.levels()[..self.directions_deg().len()];
        let most = levels.iter().copied().fold(f64::MIN, f64::max);
        most - levels.iter().copied().fold(f64::MAX, f64::min)
    }

    /// How many junctions there are.
    pub fn count(&self) -> u32 {
        match (self.phase_grid, self.turns) {
            (None, None) => self.corners,
            (grid, turns) => grid.unwrap_or(1).pow(2) * turns.unwrap_or(1),
        }
    }

    fn check(&self, place: &str) -> Result<()> {
        let refuse = |key: &str, found: String, allowed: &str| {
            Err(Error::out_of_range(place, key, found, allowed))
        };
        let angle_deg = self.angle_deg();
        match self.junction {
            Kind::Y if angle_deg <= 5.0 => {
                return refuse("angle_deg", angle_deg.to_string(), "more than 5 for a Y");
            }
            Kind::Arrow if angle_deg >= 90.0 => {
                return refuse("angle_deg", angle_deg.to_string(), "below 90 for an arrow");
            }
            _ => {}
        }
        let is_l = self.junction == Kind::L;
        if let Some(neighbour_px) = self.neighbour_px.filter(|_| !is_l) {
            return refuse("neighbour_px", neighbour_px.to_string(), "given for an L only");
        }
        if self.rounding_px > 0.0 && !(is_l && self.neighbour_px.is_none()) {
            let allowed = "0, or given for an L without neighbour";
            return refuse("rounding_px", self.rounding_px.to_string(), allowed);
        }
        Ok(())
    }
}

/// The cells that a plan's tables stand for.
///
/// # Errors
/// For an unknown key or a value out of range, two cells of one name, or too many.
pub(super) fn cells(place: &str, tables: &[Table]) -> Result<Vec<Cell>> {
    let mut cells = Vec::new();
    for (index, table) in tables.iter().enumerate() {
        let place = format!("{place}: drawn.{index}");
        for (labels, table) in alternatives::values(&place, table, "junction")? {
            let factors: Factors = registry::parameters(&place, &table)?;
            let given = table;
            factors.check(&place)?;
            let kind = factors.junction.junction().name();
            let is_said = labels.first().is_some_and(|label| label == kind);
            let mut words = if is_said { Vec::new() } else { vec![kind.to_owned()] };
            words.extend(labels);
            cells.push(Cell { name: words.join("-"), factors, table: index, given });
        }
    }
    Ok(cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Cell>> {
        let table: Table = text.parse().expect("TOML");
        cells("plan", &[table])
    }

    #[test]
    fn every_combination_is_a_cell_of_its_own_name() {
        let cells = read("junction = ['L', 'Y']\ngaussian_sigma_px = [0.5, 1]").expect("cells");
        let names: Vec<&str> = cells.iter().map(|cell| cell.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "L-gaussian_sigma_px=0.5",
                "L-gaussian_sigma_px=1",
                "Y-gaussian_sigma_px=0.5",
                "Y-gaussian_sigma_px=1"
            ]
        );
        assert_eq!(cells[3].factors.directions_deg(), [0.0, 120.0, 240.0]);
        assert_eq!(read("angle_deg = 60").expect("one")[0].name, "L");
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        let refused = |text: &str| read(text).expect_err(text).to_string();
        assert!(refused("junction = 'arrow'\nangle_deg = 120").contains("below 90"));
        assert!(refused("junction = 'Y'\nneighbour_px = 5").contains("an L only"));
        assert!(refused("neighbour_px = 5\nrounding_px = 1").contains("without neighbour"));
        assert!(refused("angle = 60").contains("did you mean \"angle_deg\"?"));
    }

    #[test]
    fn a_grid_and_turns_decide_how_many_there_are() {
        let count = |text: &str| read(text).expect("a cell")[0].factors.count();
        assert_eq!(count("corners = 7"), 7);
        assert_eq!(count("phase_grid = 16\nturns = 24"), 6144);
    }
}
