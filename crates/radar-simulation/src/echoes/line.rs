//! Echoes of straight lines: tubes, rounded edges and the inner edges of right angles. Each reflects
//! from one point, where the law of reflection about the line holds.

use std::f64::consts::{FRAC_PI_4, PI};

use glam::DVec3;

use radar_sar::math;

use crate::smooth::smoothstep;
use crate::world::{Edge, InnerEdge, Tube};

use super::REFLECTION_PHASE_RAD;
use super::fresnel::{MAX_FRESNEL_M, fresnel_radius_m, interval_share};

/// Angle over which an edge's echo ends where a neighbouring face's specular echo begins, rad. Choice: a
/// Fresnel zone of 5 cm at 1 m.
const SECTOR_BORDER_RAD: f64 = 0.05;

/// How the line reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum LineKind {
    /// A cylinder: σ = π d² a/(a + d) γ, which for thin ones is π a d γ (geometrical optics: the product of
    /// the two principal radii of the reflected wave; Physics).
    Cylinder { radius_m: f64 },
    /// Two perpendicular faces: σ = π d² γ₁γ₂, as the image of the sensor lies behind the edge (Physics).
    Dihedral,
}

/// Directions from the line in which it reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sector {
    /// Unit vector in its middle, perpendicular to the line.
    pub middle: DVec3,
    pub half_angle_rad: f64,
}

/// A straight reflecting line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    pub middle_m: DVec3,
    /// Unit vector along it.
    pub axis: DVec3,
    pub half_m: f64,
    pub kind: LineKind,
    /// `None`: it reflects to all sides.
    pub sector: Option<Sector>,
    /// √γ.
    pub reflection: f64,
}

/// A line's reflection between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LineEcho {
    /// Where it reflects, metres.
    pub point_m: DVec3,
    /// Half the path's length from the first point by the line to the second one, metres.
    pub range_m: f64,
    /// √σ/(d₁ d₂), 1/m.
    pub spread: f64,
}

impl Line {
    fn between(ends_m: [DVec3; 2], kind: LineKind, sector: Option<Sector>, reflectivity: f64) -> Self {
        let [from, to] = ends_m;
        Self {
            middle_m: 0.5 * (from + to),
            axis: (to - from).normalize_or(DVec3::Y),
            half_m: 0.5 * from.distance(to),
            kind,
            sector,
            reflection: reflectivity.sqrt(),
        }
    }

    pub fn of_tube(tube: &Tube) -> Self {
        Self::between(tube.ends_m, LineKind::Cylinder { radius_m: tube.radius_m }, None, tube.material.specular())
    }

    pub fn of_edge(edge: &Edge) -> Self {
        let sector = Sector { middle: edge.outward, half_angle_rad: edge.half_angle_rad };
        let kind = LineKind::Cylinder { radius_m: edge.material.edge_radius_m };
        Self::between(edge.ends_m, kind, Some(sector), edge.material.specular())
    }

    pub fn of_inner_edge(edge: &InnerEdge) -> Self {
        let sector = Sector { middle: edge.inward, half_angle_rad: std::f64::consts::FRAC_PI_4 };
        Self::between(edge.ends_m, LineKind::Dihedral, Some(sector), edge.reflectivity)
    }

    /// Echo back to the sensor.
    pub fn echo(&self, sensor_m: DVec3) -> Option<LineEcho> {
        let off = sensor_m - self.middle_m;
        let along_m = off.dot(self.axis);
        // Most lines lie aside.
        if along_m.abs() > self.half_m + MAX_FRESNEL_M {
            return None;
        }
        let across = off - self.axis * along_m;
        let distance_m = across.length();
        if distance_m < 1e-3 {
            return None;
        }
        let to_surface_m = self.surface_distance_m(distance_m);
        let share = interval_share(along_m, self.half_m, fresnel_radius_m(distance_m, distance_m));
        if share == 0.0 {
            return None;
        }
        let share = share * self.sector_share(across / distance_m);
        let sigma_by_d2 = match self.kind {
            LineKind::Cylinder { radius_m } => PI * radius_m / (radius_m + to_surface_m),
            LineKind::Dihedral => PI,
        };
        (share > 0.0).then(|| LineEcho {
            point_m: self.middle_m + self.axis * along_m,
            range_m: to_surface_m,
            spread: sigma_by_d2.sqrt() * self.reflection * share / to_surface_m,
        })
    }

    /// Range of the echo back to the sensor alone, metres.
    pub fn range_m(&self, sensor_m: DVec3) -> f64 {
        let off = sensor_m - self.middle_m;
        self.surface_distance_m((off - self.axis * off.dot(self.axis)).length())
    }

    /// Phase of the reflection: one bounce, or two that add up to a whole turn.
    pub fn phase_rad(&self) -> f64 {
        match self.kind {
            LineKind::Cylinder { .. } => REFLECTION_PHASE_RAD,
            LineKind::Dihedral => 0.0,
        }
    }

    fn surface_distance_m(&self, distance_m: f64) -> f64 {
        match self.kind {
            LineKind::Cylinder { radius_m } => (distance_m - radius_m).max(1e-3),
            LineKind::Dihedral => distance_m,
        }
    }

    /// Reflection from one point to another, for thin cylinders; `None` for dihedrals, which return only to
    /// where the wave came from.
    ///
    /// Unrolled about the line, the path is straight: it crosses the line at the mean of the two feet,
    /// weighted by the other point's distance. σ/(d₁ d₂)² = 2π a γ/(d₁ d₂ (d₁ + d₂)), at d₁ = d₂ that of
    /// [`Line::echo`]; the factor cos β/cos θ of oblique incidence is left out (below 3 dB up to 60°).
    pub fn bistatic(&self, from_m: DVec3, to_m: DVec3) -> Option<LineEcho> {
        let LineKind::Cylinder { radius_m } = self.kind else { return None };
        let offs = [from_m - self.middle_m, to_m - self.middle_m];
        let along_m = offs.map(|off| off.dot(self.axis));
        let across = [offs[0] - self.axis * along_m[0], offs[1] - self.axis * along_m[1]];
        let [near_m, far_m] = across.map(|a| a.length().max(1e-3));
        let at_m = (along_m[0] * far_m + along_m[1] * near_m) / (near_m + far_m);
        let [d1_m, d2_m] =
            [(near_m, along_m[0]), (far_m, along_m[1])].map(|(r, t)| (r * r + (t - at_m).powi(2)).sqrt());
        let bisector = (across[0] / near_m + across[1] / far_m).normalize_or_zero();
        // Forward scattering, where the line lies between both points, is no reflection.
        if bisector == DVec3::ZERO {
            return None;
        }
        let share = interval_share(at_m, self.half_m, fresnel_radius_m(d1_m, d2_m));
        if share == 0.0 {
            return None;
        }
        let share = share * self.sector_share(bisector);
        (share > 0.0).then(|| LineEcho {
            point_m: self.middle_m + self.axis * at_m,
            range_m: 0.5 * (d1_m + d2_m) - radius_m,
            spread: (2.0 * PI * radius_m / (d1_m * d2_m * (d1_m + d2_m))).sqrt() * self.reflection * share,
        })
    }

    /// √(π a γ) of a cylinder, which divided by √d³ is the field that it returns; 0 for dihedrals.
    pub fn strength(&self) -> f64 {
        match self.kind {
            LineKind::Cylinder { radius_m } => (PI * radius_m).sqrt() * self.reflection,
            LineKind::Dihedral => 0.0,
        }
    }

    /// The line longer by `slack_m` at both ends and wider open by `slack_rad`: what it reflects includes all that the
    /// line itself reflects to places nearby.
    pub fn widened(&self, slack_m: f64, slack_rad: f64) -> Self {
        let sector = self.sector.map(|s| Sector { half_angle_rad: s.half_angle_rad + slack_rad, ..s });
        Self { half_m: self.half_m + slack_m, sector, ..*self }
    }

    /// 1 inside the sector, 0 outside.
    fn sector_share(&self, direction: DVec3) -> f64 {
        let Some(sector) = self.sector else { return 1.0 };
        let cos = sector.middle.dot(direction);
        if cos < 0.0 && sector.half_angle_rad < FRAC_PI_4 + 0.5 {
            return 0.0;
        }
        let off_rad = math::acos(cos.clamp(-1.0, 1.0));
        smoothstep(0.5 * ((sector.half_angle_rad - off_rad) / SECTOR_BORDER_RAD + 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::material::{METAL, WOOD};

    fn pole() -> Line {
        let ends_m = [DVec3::ZERO, DVec3::Y * 2.0];
        Line::of_tube(&Tube { ends_m, radius_m: 0.01, material: METAL })
    }

    #[test]
    fn thin_pole_has_the_cross_section_of_a_cylinder() {
        for d in [0.5, 2.0] {
            let echo = pole().echo(DVec3::new(d + 0.01, 1.0, 0.0)).unwrap();
            let sigma = (echo.spread * d * d).powi(2);
            let expected = PI * 0.01 * d * 0.99;
            assert!((echo.range_m - d).abs() < 1e-12);
            assert!((10.0 * (sigma / expected).log10()).abs() < 0.1, "{sigma} {expected}");
        }
        assert!(pole().echo(DVec3::new(1.0, 2.1, 0.0)).is_none());
    }

    #[test]
    fn thick_cylinder_becomes_a_mirror() {
        let tube = Tube { ends_m: [DVec3::NEG_Y * 9.0, DVec3::Y * 9.0], radius_m: 1e4, material: METAL };
        let echo = Line::of_tube(&tube).echo(DVec3::X * (1e4 + 1.0)).unwrap();
        assert!((echo.spread.powi(2) / (PI * 0.99) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn reflection_between_points_agrees_with_the_echo_and_obeys_the_law_of_reflection() {
        let sensor = DVec3::new(0.8, 0.7, 0.6);
        let (echo, both) = (pole().echo(sensor).unwrap(), pole().bistatic(sensor, sensor).unwrap());
        assert!((both.range_m - echo.range_m).abs() < 1e-12 && both.point_m.distance(echo.point_m) < 1e-12);
        assert!((both.spread / echo.spread - 1.0).abs() < 0.02);
        let (from, to) = (DVec3::new(1.0, 0.4, 0.0), DVec3::new(0.2, 1.7, 0.5));
        let at = pole().bistatic(from, to).unwrap().point_m;
        let slopes = [from, to].map(|p| (p - at).normalize().y);
        assert!((slopes[0] + slopes[1]).abs() < 1e-12, "{slopes:?}");
    }

    #[test]
    fn edge_reflects_only_between_its_faces_normals() {
        let ends_m = [DVec3::NEG_Z, DVec3::Z];
        let outward = DVec3::new(1.0, 1.0, 0.0).normalize();
        let edge = Line::of_edge(&Edge { ends_m, outward, half_angle_rad: PI / 4.0, material: WOOD });
        let spread = |deg: f64| {
            let direction = DVec3::new(deg.to_radians().cos(), deg.to_radians().sin(), 0.0);
            edge.echo(direction * 1.5).map_or(0.0, |e| e.spread)
        };
        assert!((spread(45.0) - spread(10.0)).abs() < 1e-12 && spread(45.0) > 0.0);
        assert!((spread(0.0) / spread(45.0) - 0.5).abs() < 1e-9);
        assert_eq!((spread(-10.0), spread(100.0), spread(225.0)), (0.0, 0.0, 0.0));
    }

    #[test]
    fn inner_edge_is_as_strong_as_two_mirrors() {
        let inward = DVec3::new(1.0, 1.0, 0.0).normalize();
        let line = Line::of_inner_edge(&InnerEdge { ends_m: [DVec3::NEG_Z, DVec3::Z], inward, reflectivity: 0.01 });
        for d in [1.0, 2.0] {
            let echo = line.echo(inward * d).unwrap();
            assert!(((echo.spread * d * d).powi(2) / (PI * d * d * 0.01) - 1.0).abs() < 1e-12);
        }
        assert!(line.bistatic(inward, inward).is_none());
    }
}
