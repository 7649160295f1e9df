//! Beam pattern: amplitude of an echo against the angle from the boresight.
//!
//! The same pattern holds in both planes. A(θ) is the two-way amplitude factor, which equals the
//! one-way power pattern. No pattern of the bare A121 is published: the half-power width without a
//! lens is that of the A111 (60°). Lenses are the means of both planes of the vendor's lens kit at
//! its shorter focal distance. The beam is therefore a setting.

use serde::{Deserialize, Serialize};

use crate::math;

/// An invalid beam.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BeamError {
    /// Unknown name.
    #[error(
        "beam \"{0}\" is not known: use uniform, thesis, lensless, fresnel, hyperbolic, or a table of [angle_deg, factor]"
    )]
    UnknownName(String),
    /// Too few rows to interpolate.
    #[error("beam table has {0} rows: give at least 2 of [angle_deg, factor]")]
    TooShort(usize),
    /// An invalid row.
    #[error("beam table row {row} is [{angle_deg}, {factor}]: angles must rise within 0 to 180, factors lie in 0 to 1")]
    BadRow {
        /// Index of the row, from 0.
        row: usize,
        /// Its angle.
        angle_deg: f64,
        /// Its factor.
        factor: f64,
    },
}

/// Two-way amplitude against the angle from the boresight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub enum Beam {
    /// A = 1 everywhere.
    Uniform,
    /// As in the thesis: the lobe of a lens (half at 20°), zero beyond 45°. Figure 3.3 of the
    /// thesis gives no numbers; the width follows from its text and lens.
    Thesis,
    /// No lens: half at 30°, zero behind the sensor.
    Lensless,
    /// Fresnel lens: half at 11.75°, +5.7 dB loop gain.
    Fresnel,
    /// Hyperbolic lens: half at 13.75°, +5.8 dB loop gain.
    Hyperbolic,
    /// Rows of angle (degrees, rising) and factor (0 to 1); linear in between, 0 beyond the last
    /// row.
    Table(Vec<[f64; 2]>),
}

/// Serialised form of a beam in settings and recordings.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Name(String),
    Table(Vec<[f64; 2]>),
}

impl TryFrom<Written> for Beam {
    type Error = BeamError;
    fn try_from(written: Written) -> Result<Self, BeamError> {
        match written {
            Written::Name(name) => Self::from_name(&name),
            Written::Table(rows) => Self::from_table(rows),
        }
    }
}

impl From<Beam> for Written {
    fn from(beam: Beam) -> Self {
        match beam {
            Beam::Uniform => Self::Name("uniform".into()),
            Beam::Thesis => Self::Name("thesis".into()),
            Beam::Lensless => Self::Name("lensless".into()),
            Beam::Fresnel => Self::Name("fresnel".into()),
            Beam::Hyperbolic => Self::Name("hyperbolic".into()),
            Beam::Table(rows) => Self::Table(rows),
        }
    }
}

impl Beam {
    /// The beam with this name.
    ///
    /// # Errors
    /// Unknown name.
    pub fn from_name(name: &str) -> Result<Self, BeamError> {
        match name {
            "uniform" => Ok(Self::Uniform),
            "thesis" => Ok(Self::Thesis),
            "lensless" => Ok(Self::Lensless),
            "fresnel" => Ok(Self::Fresnel),
            "hyperbolic" => Ok(Self::Hyperbolic),
            other => Err(BeamError::UnknownName(other.into())),
        }
    }

    /// A beam from a measured table.
    ///
    /// # Errors
    /// Fewer than two rows, angles that do not rise, values out of range or not finite.
    pub fn from_table(rows: Vec<[f64; 2]>) -> Result<Self, BeamError> {
        if rows.len() < 2 {
            return Err(BeamError::TooShort(rows.len()));
        }
        for (row, &[angle_deg, factor]) in rows.iter().enumerate() {
            let rises = row == 0 || angle_deg > rows[row - 1][0];
            if !rises || !(0.0..=180.0).contains(&angle_deg) || !(0.0..=1.0).contains(&factor) {
                return Err(BeamError::BadRow { row, angle_deg, factor });
            }
        }
        Ok(Self::Table(rows))
    }

    /// Two-way amplitude factor at the angle with this cosine; 0 beyond the cut-off.
    #[inline]
    pub fn amplitude(&self, cos_off_boresight: f64) -> f64 {
        let angle_deg = math::acos(cos_off_boresight.clamp(-1.0, 1.0)).to_degrees();
        let lobe = |half_deg: f64, cut_deg: f64| {
            if angle_deg > cut_deg { 0.0 } else { math::exp(-std::f64::consts::LN_2 * (angle_deg / half_deg).powi(2)) }
        };
        match self {
            Self::Uniform => 1.0,
            Self::Thesis => lobe(20.0, 45.0),
            Self::Lensless => lobe(30.0, 90.0),
            Self::Fresnel => lobe(11.75, 90.0),
            Self::Hyperbolic => lobe(13.75, 90.0),
            Self::Table(rows) => interpolate(rows, angle_deg),
        }
    }

    /// Cosine of the widest angle with an amplitude of at least `floor`, to 0.05°; −1 if the beam
    /// never falls below it.
    pub fn cut_off_cos(&self, floor: f64) -> f64 {
        let steps = (0..=3600).map(|i| f64::from(i) * 0.05f64);
        let widest = steps.take_while(|deg| self.amplitude(math::cos(deg.to_radians())) >= floor).last();
        widest.map_or(1.0, |deg| math::cos(deg.to_radians()))
    }

    /// Loop gain that the lens adds on the axis, dB.
    pub fn gain_db(&self) -> f64 {
        match self {
            Self::Fresnel => 5.7,
            Self::Hyperbolic => 5.8,
            Self::Uniform | Self::Thesis | Self::Lensless | Self::Table(_) => 0.0,
        }
    }
}

fn interpolate(rows: &[[f64; 2]], angle_deg: f64) -> f64 {
    let above = rows.partition_point(|row| row[0] < angle_deg);
    match above {
        0 => rows[0][1],
        n if n == rows.len() => 0.0,
        n => {
            let ([a, fa], [b, fb]) = (rows[n - 1], rows[n]);
            fa + (fb - fa) * (angle_deg - a) / (b - a)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(beam: &Beam, deg: f64) -> f64 {
        beam.amplitude(deg.to_radians().cos())
    }

    #[test]
    fn thesis_beam_is_zero_beyond_45_degrees() {
        assert!(at(&Beam::Thesis, 44.9) > 0.0);
        assert_eq!(at(&Beam::Thesis, 45.1), 0.0);
        assert_eq!(at(&Beam::Uniform, 179.0), 1.0);
        assert!((at(&Beam::Lensless, 30.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn table_is_interpolated_and_zero_beyond_its_end() {
        let beam = Beam::from_table(vec![[0.0, 1.0], [20.0, 0.5], [40.0, 0.1]]).unwrap();
        assert!((at(&beam, 10.0) - 0.75).abs() < 1e-9);
        assert_eq!(at(&beam, 41.0), 0.0);
        assert!((beam.cut_off_cos(0.5).acos().to_degrees() - 20.0).abs() < 0.06);
    }

    #[test]
    fn invalid_tables_and_names_are_rejected() {
        assert!(matches!(Beam::from_table(vec![[0.0, 1.0]]), Err(BeamError::TooShort(1))));
        assert!(matches!(Beam::from_table(vec![[0.0, 1.0], [0.0, 0.5]]), Err(BeamError::BadRow { row: 1, .. })));
        assert!(matches!(Beam::from_table(vec![[0.0, 1.0], [5.0, f64::NAN]]), Err(BeamError::BadRow { row: 1, .. })));
        assert!(Beam::from_name("laser").unwrap_err().to_string().contains("lensless"));
    }

    #[test]
    fn serde_accepts_a_name_or_a_table() {
        let beam: Beam = serde_json::from_str("\"fresnel\"").unwrap();
        assert_eq!(beam, Beam::Fresnel);
        let beam: Beam = serde_json::from_str("[[0, 1], [30, 0.25]]").unwrap();
        assert_eq!(serde_json::to_string(&beam).unwrap(), "[[0.0,1.0],[30.0,0.25]]");
    }
}
