//! What surfaces are made of, at 60 GHz.

/// A material's reflection, roughness and transmission.
///
/// Reflectivities are those of the vendor's handbook at normal incidence; they are kept at oblique
/// incidence, where both polarisations on average reflect no less.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Material {
    /// Reflected power at normal incidence, γ.
    pub reflectivity: f64,
    /// Share of the reflected power that is scattered diffusely.
    pub diffuse_share: f64,
    /// Power that passes through a panel once.
    pub transmission: f64,
    /// Radius of a panel's rounded edges, metres.
    pub edge_radius_m: f64,
}

impl Material {
    /// Specularly reflected power at normal incidence.
    pub fn specular(&self) -> f64 {
        self.reflectivity * (1.0 - self.diffuse_share)
    }

    /// Diffusely reflected power.
    pub fn diffuse(&self) -> f64 {
        self.reflectivity * self.diffuse_share
    }
}

const fn material(reflectivity: f64, diffuse_share: f64, transmission: f64, edge_radius_m: f64) -> Material {
    Material { reflectivity, diffuse_share, transmission, edge_radius_m }
}

// Reflectivities. Source: the vendor's handbook, except where a comment says otherwise. Diffuse
// shares, for height deviations of σ about 1 − exp(−(4πσ/λ)²) (Rayleigh's criterion; Physics):
// 6 % for σ 0.1 mm, 44 % for 0.3 mm. Transmissions from 73 GHz attenuations (drywall 0.8 to 9.9
// dB/cm, plywood 8.1 dB/cm: arXiv 1703.08030) and a usual thickness. Edge radii. Choice: as
// furniture is built, so that nobody cuts himself.

/// Plasterboard on studs, two boards of 12.5 mm at 5 dB/cm.
pub(crate) const PLASTERBOARD: Material = material(0.059, 0.05, 0.05, 3e-3);
/// Plaster on brick, which nothing passes.
pub(crate) const PLASTER: Material = material(0.059, 0.1, 0.0, 4e-3);
/// Cast or rendered concrete.
pub(crate) const CONCRETE: Material = material(0.11, 0.35, 0.0, 5e-3);
/// Planed or varnished wood and laminate of 18 mm or more.
pub(crate) const WOOD: Material = material(0.046, 0.08, 0.0, 2e-3);
/// Rough-sawn or brushed wood.
pub(crate) const ROUGH_WOOD: Material = material(0.046, 0.3, 0.0, 4e-3);
/// Glass of 4 to 8 mm. Choice of transmission: the rest after two reflections of 20 % and some
/// absorption.
pub(crate) const GLASS: Material = material(0.20, 0.01, 0.35, 1.5e-3);
/// One layer of cloth.
pub(crate) const TEXTILE: Material = material(0.029, 0.7, 0.75, 1e-2);
/// Cloth over foam on a frame. Choice of transmission: some centimetres of foam and the frame.
pub(crate) const UPHOLSTERY: Material = material(0.029, 0.8, 0.15, 3e-2);
/// Leather over foam. Choice: between cloth and skin, smoother than cloth.
pub(crate) const LEATHER: Material = material(0.06, 0.4, 0.1, 3e-2);
/// ABS of 3 mm: handbook .05 to .11.
pub(crate) const PLASTIC: Material = material(0.08, 0.1, 0.5, 2e-3);
/// Sheet metal and steel tube; paint hides nothing at 60 GHz.
pub(crate) const METAL: Material = material(1.0, 0.01, 0.0, 1.2e-3);
/// Metal with rust, hammered paint or woven wire. Choice: a tenth of the power is scattered.
pub(crate) const ROUGH_METAL: Material = material(0.8, 0.1, 0.05, 2e-3);
/// Books and paper: wood's reflectivity (both are cellulose), backs of unequal depth.
pub(crate) const PAPER: Material = material(0.046, 0.7, 0.0, 3e-3);
/// Leaves of a plant. Choice: half of skin, as they are thin and half of them is water.
pub(crate) const LEAF: Material = material(0.11, 0.5, 0.4, 1e-3);
/// Carpet on a solid floor: textile above, nothing passes below.
pub(crate) const CARPET: Material = material(0.029, 0.8, 0.0, 5e-3);
/// Ceramic tile and stone. Choice: concrete's reflectivity, glazed smooth.
pub(crate) const TILE: Material = material(0.11, 0.05, 0.0, 2e-3);
/// Mineral-fibre ceiling tiles. Choice: textile's reflectivity, rough by design.
pub(crate) const MINERAL_FIBRE: Material = material(0.029, 0.6, 0.3, 3e-3);
