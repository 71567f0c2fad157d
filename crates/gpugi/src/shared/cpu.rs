//! The reflection models in double precision, and their integrals by quadrature. Tests compare the shaders with them.
//!
//! The formulas are written from the papers, not translated from brdf.wesl, and nothing here uses random numbers.

use std::f64::consts::TAU;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// `Case` of testing/brdf.wesl: a reflectance, a surface and an eye.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Case {
    pub diffuse: [f32; 3],
    pub model: u32,
    pub f0: [f32; 3],
    pub f90: f32,
    pub n: [f32; 3],
    pub roughness: f32,
    pub k: [f32; 3],
    pub shininess: f32,
    pub normal: [f32; 3],
    pub samples: u32,
    pub wo: [f32; 3],
    pub seed: u32,
    pub tint: [f32; 3],
    pub transmission: f32,
    pub eta: f32,
    pub thin: u32,
    pub padding: [u32; 2],
    pub diffuse_transmitted: [f32; 3],
    pub padding_2: u32,
}

/// Complex refractive index of gold at 650, 550 and 450 nm (Johnson and Christy 1972).
pub const GOLD: ([f32; 3], [f32; 3]) = ([0.143, 0.375, 1.442], [3.983, 2.386, 1.603]);

impl Case {
    const GGX: u32 = 0;
    const PHONG: u32 = 1;
    const CONDUCTOR: u32 = 2;
    const BLINN: u32 = 3;

    /// A white dielectric of index 1.5 with normal +Z, seen from straight above.
    pub fn dielectric(roughness: f32) -> Self {
        Self {
            diffuse: [1.0; 3],
            model: Self::GGX,
            f0: [0.04; 3],
            f90: 1.0,
            n: [0.0; 3],
            roughness,
            k: [0.0; 3],
            shininess: 0.0,
            normal: [0.0, 0.0, 1.0],
            samples: 0,
            wo: [0.0, 0.0, 1.0],
            seed: 1,
            tint: [1.0; 3],
            transmission: 0.0,
            eta: 1.0,
            thin: 0,
            padding: [0; 2],
            diffuse_transmitted: [0.0; 3],
            padding_2: 0,
        }
    }

    /// A solid of clear glass; `eta` is the index behind the surface divided by that in front.
    pub fn glass(roughness: f32, eta: f32) -> Self {
        Self {
            diffuse: [0.0; 3],
            f0: [((eta - 1.0) / (eta + 1.0)).powi(2); 3],
            transmission: 1.0,
            eta,
            ..Self::dielectric(roughness)
        }
    }

    /// A thin wall of glass.
    pub fn pane(roughness: f32) -> Self {
        Self {
            thin: 1,
            ..Self::glass(roughness, 1.5)
        }
    }

    /// A dielectric that reflects and transmits diffusely what its glossy lobe leaves.
    pub fn translucent(roughness: f32) -> Self {
        Self {
            diffuse: [0.4; 3],
            diffuse_transmitted: [0.6; 3],
            ..Self::dielectric(roughness)
        }
    }

    /// A coloured metal that reflects all red light.
    pub fn metal(roughness: f32) -> Self {
        Self {
            diffuse: [0.0; 3],
            f0: [1.0, 0.7, 0.2],
            ..Self::dielectric(roughness)
        }
    }

    /// Gold by its refractive index.
    pub fn gold(roughness: f32) -> Self {
        let (n, k) = GOLD;
        Self {
            diffuse: [0.0; 3],
            model: Self::CONDUCTOR,
            n,
            k,
            ..Self::dielectric(roughness)
        }
    }

    /// Diffuse and Phong lobes that together reflect everything.
    pub fn phong(shininess: f32) -> Self {
        Self {
            diffuse: [0.3, 0.0, 1.0],
            f0: [0.7, 1.0, 0.0],
            model: Self::PHONG,
            shininess,
            ..Self::dielectric(1.0)
        }
    }

    /// The same with Blinn's lobe.
    pub fn blinn(shininess: f32) -> Self {
        Self {
            model: Self::BLINN,
            ..Self::phong(shininess)
        }
    }

    /// The same case, seen at `degrees` from the normal. Both directions are rotated so that no axis is special.
    pub fn seen_at(mut self, degrees: f64) -> Self {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, -0.7, 0.2).normalize(), 2.1);
        self.wo = (turn * DVec3::new(sine * 0.8, sine * 0.6, cosine))
            .as_vec3()
            .to_array();
        self.normal = (turn * DVec3::Z).as_vec3().to_array();
        self
    }

    pub fn normal(&self) -> DVec3 {
        Vec3::from(self.normal).as_dvec3().normalize()
    }

    pub fn wo(&self) -> DVec3 {
        Vec3::from(self.wo).as_dvec3().normalize()
    }

    /// Phong or Blinn.
    pub fn has_exponent(&self) -> bool {
        self.model == Self::PHONG || self.model == Self::BLINN
    }

    fn alpha(&self) -> f64 {
        f64::from(self.roughness).powi(2)
    }

    /// The central direction of the glossy lobe, and the tangent of half its half-width.
    pub fn glossy_lobe(&self) -> (DVec3, f64) {
        let (n, wo) = (self.normal(), self.wo());
        let width = if self.has_exponent() {
            (1.0 / (f64::from(self.shininess) + 1.0)).sqrt()
        } else {
            self.alpha()
        };
        (2.0 * n.dot(wo) * n - wo, width)
    }

    /// The same for the transmission lobe. Its centre is the refracted direction, or a direction near the surface if
    /// there is none.
    pub fn transmitted_lobe(&self) -> (DVec3, f64) {
        let (n, wo, eta) = (self.normal(), self.wo(), f64::from(self.eta));
        if self.thin == 1 {
            return (-wo, self.alpha());
        }
        let along = (n.dot(wo) * n - wo) / eta;
        let down = (1.0 - along.length_squared()).max(0.1).sqrt();
        (
            (along - down * n).normalize(),
            self.alpha() * (1.0 - eta).abs(),
        )
    }

    /// Fresnel reflectance of a facet in one channel.
    pub fn facet(&self, channel: usize, cosine: f64) -> f64 {
        if self.model == Self::CONDUCTOR {
            return conductor(self.n[channel].into(), self.k[channel].into(), cosine);
        }
        if self.transmission > 0.0 {
            return dielectric(self.eta.into(), cosine);
        }
        let f0 = f64::from(self.f0[channel]);
        f0 + (f64::from(self.f90) - f0) * (1.0 - cosine).powi(5)
    }

    /// Albedo of the diffuse lobe for this eye: what the glossy lobe leaves, by the blurred Schlick curve of brdf.wesl.
    /// The bound on the whole albedo checks it against the model.
    pub fn diffuse_albedo(&self, channel: usize) -> f64 {
        let albedo = f64::from(self.diffuse[channel]);
        if self.model != Self::GGX {
            return if self.has_exponent() { albedo } else { 0.0 };
        }
        let roughness = f64::from(self.roughness);
        let f0 = self.f0.map(f64::from).into_iter().fold(0.0, f64::max);
        let cosine = self.normal().dot(self.wo());
        let weight = (1.0 - cosine).powf(5.0 / (1.0 + 1.475 * roughness));
        let blurred = weight / (1.0 + 22.5 * roughness.powf(2.5));
        albedo * (1.0 - (f0 + (f64::from(self.f90) - f0) * blurred))
    }

    /// Albedo of the glossy lobe for this eye.
    pub fn glossy_albedo(&self, channel: usize) -> f64 {
        match self.model {
            Self::PHONG => self.phong_albedo(channel),
            Self::BLINN => self.blinn_albedo(channel),
            _ => self.ggx_albedo(channel),
        }
    }

    fn ggx_albedo(&self, channel: usize) -> f64 {
        let (n, wo) = (self.normal(), self.wo());
        let n_dot_v = n.dot(wo);
        self.over_facets(|h| {
            let v_dot_h = wo.dot(h);
            let n_dot_l = n.dot(2.0 * v_dot_h * h - wo);
            if v_dot_h <= 0.0 || n_dot_l <= 0.0 {
                return 0.0;
            }
            // f cos dwi = F D G2 / (4 n.v) dwi, dwi = 4 (v.h) dh.
            let g2 = 1.0 / (1.0 + self.lambda(n_dot_v) + self.lambda(n_dot_l));
            self.facet(channel, v_dot_h) * g2 * v_dot_h / n_dot_v
        })
    }

    /// The fraction of light that passes, without the tint. One channel only, because all are equal.
    pub fn transmitted_albedo(&self) -> f64 {
        let (n, wo, eta) = (self.normal(), self.wo(), f64::from(self.eta));
        let n_dot_v = n.dot(wo);
        self.over_facets(|h| {
            let v_dot_h = wo.dot(h);
            let squared = 1.0 - (1.0 - v_dot_h * v_dot_h) / (eta * eta);
            if v_dot_h <= 0.0 || squared <= 0.0 {
                return 0.0;
            }
            let (wi, g2) = if self.thin == 1 {
                let up = 2.0 * v_dot_h * h - wo;
                let below = up - 2.0 * n.dot(up) * n;
                let g2 = 1.0 / (1.0 + self.lambda(n_dot_v) + self.lambda(n.dot(up)));
                (below, g2)
            } else {
                // Snell: the tangential component shrinks by eta.
                let wi = -(wo - v_dot_h * h) / eta - squared.sqrt() * h;
                let g1 = |cosine: f64| 1.0 / (1.0 + self.lambda(cosine));
                (wi, g1(n_dot_v) * g1(n.dot(wi)))
            };
            if n.dot(wi) >= 0.0 {
                return 0.0;
            }
            // f cos dwi eta^2 = (1 - F) D G v.h |l.h| / (n.v ..^2) eta^2 dwi, dh = eta^2 |l.h| / ..^2 dwi.
            (1.0 - self.facet(0, v_dot_h)) * g2 * v_dot_h / n_dot_v
        })
    }

    /// Smith's Lambda of GGX (Walter et al. 2007).
    fn lambda(&self, cosine: f64) -> f64 {
        let tan2 = (1.0 - cosine * cosine) / (cosine * cosine);
        ((1.0 + self.alpha() * self.alpha() * tan2).sqrt() - 1.0) / 2.0
    }

    /// Integral of value D over half vectors: D (n.h) dh = dt dphi / (2 pi) with tan^2(theta_h) = alpha^2 t / (1 - t),
    /// and t = 1 - w^3 with evenly spaced w, which is denser in the distribution's long tail.
    fn over_facets(&self, value: impl Fn(DVec3) -> f64) -> f64 {
        const STEPS: usize = 400;
        let (frame, alpha) = (frame(self.normal()), self.alpha());
        let mut sum = 0.0;
        for i in 0..STEPS {
            let w = (i as f64 + 0.5) / STEPS as f64;
            let rest = w.powi(3);
            let c = (1.0 / (1.0 + alpha * alpha * (1.0 - rest) / rest)).sqrt();
            let s = (1.0 - c * c).max(0.0).sqrt();
            for j in 0..STEPS {
                let phi = TAU * (j as f64 + 0.5) / STEPS as f64;
                let h = frame * DVec3::new(s * phi.cos(), s * phi.sin(), c);
                sum += value(h) / c * 3.0 * w * w;
            }
        }
        sum / (STEPS * STEPS) as f64
    }

    /// Integral over half vectors, with evenly spaced (n.h)^(n+2): f cos dwi = f n.l 4 (v.h) dh. The factor is the
    /// inverse of the integral from straight above, 8 pi int c^(n+1) (2 c^2 - 1) dc from sqrt(1/2) to 1.
    fn blinn_albedo(&self, channel: usize) -> f64 {
        const STEPS: usize = 400;
        let (n, wo) = (self.normal(), self.wo());
        let (frame, exponent) = (frame(n), f64::from(self.shininess));
        let antiderivative = |c: f64| {
            2.0 * c.powf(exponent + 4.0) / (exponent + 4.0)
                - c.powf(exponent + 2.0) / (exponent + 2.0)
        };
        let from_above = 4.0 * TAU * (antiderivative(1.0) - antiderivative(0.5_f64.sqrt()));
        let mut sum = 0.0;
        for i in 0..STEPS {
            let c = ((i as f64 + 0.5) / STEPS as f64).powf(1.0 / (exponent + 2.0));
            let s = (1.0 - c * c).sqrt();
            for j in 0..STEPS {
                let phi = TAU * (j as f64 + 0.5) / STEPS as f64;
                let v_dot_h = wo.dot(frame * DVec3::new(s * phi.cos(), s * phi.sin(), c));
                let n_dot_l = 2.0 * v_dot_h * c - n.dot(wo);
                if v_dot_h > 0.0 && n_dot_l > 0.0 {
                    sum += 4.0 * v_dot_h * n_dot_l / c;
                }
            }
        }
        let mean = sum / (STEPS * STEPS) as f64;
        f64::from(self.f0[channel]) * mean * TAU / (exponent + 2.0) / from_above
    }

    /// Integral around the mirror direction, with evenly spaced cos^(n+1).
    fn phong_albedo(&self, channel: usize) -> f64 {
        const STEPS: usize = 400;
        let (mirror, _) = self.glossy_lobe();
        let (frame, n) = (frame(mirror), self.normal());
        let exponent = f64::from(self.shininess);
        let mut sum = 0.0;
        for i in 0..STEPS {
            let c = ((i as f64 + 0.5) / STEPS as f64).powf(1.0 / (exponent + 1.0));
            let s = (1.0 - c * c).sqrt();
            for j in 0..STEPS {
                let phi = TAU * (j as f64 + 0.5) / STEPS as f64;
                sum += n
                    .dot(frame * DVec3::new(s * phi.cos(), s * phi.sin(), c))
                    .max(0.0);
            }
        }
        // (n+2)/(2 pi) 2 pi / (n+1).
        f64::from(self.f0[channel]) * (exponent + 2.0) / (exponent + 1.0) * sum
            / (STEPS * STEPS) as f64
    }
}

/// Reflectance of a metal in air by complex arithmetic: Snell and Fresnel, without a real-valued rearrangement.
pub fn conductor(n: f64, k: f64, cosine: f64) -> f64 {
    type Complex = (f64, f64);
    let mul = |a: Complex, b: Complex| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let div = |a: Complex, b: Complex| {
        let d = b.0 * b.0 + b.1 * b.1;
        ((a.0 * b.0 + a.1 * b.1) / d, (a.1 * b.0 - a.0 * b.1) / d)
    };
    let sqrt = |a: Complex| {
        let r = a.0.hypot(a.1);
        (
            ((r + a.0) / 2.0).max(0.0).sqrt(),
            ((r - a.0) / 2.0).max(0.0).sqrt().copysign(a.1),
        )
    };
    let index = (n, k);
    let squared = mul(index, index);
    // Cosine of the refracted ray times the index: sqrt(index^2 - sin^2).
    let refracted = sqrt((squared.0 - (1.0 - cosine * cosine), squared.1));
    let norm = |a: Complex| a.0 * a.0 + a.1 * a.1;
    let rs = norm(div(
        (cosine - refracted.0, -refracted.1),
        (cosine + refracted.0, refracted.1),
    ));
    let along = (squared.0 * cosine, squared.1 * cosine);
    let rp = norm(div(
        (along.0 - refracted.0, along.1 - refracted.1),
        (along.0 + refracted.0, along.1 + refracted.1),
    ));
    (rs + rp) / 2.0
}

/// Reflectance of a dielectric from the angles of Snell's law: Rs = (sin(i - t) / sin(i + t))^2, Rp = (tan(i - t) /
/// tan(i + t))^2.
pub fn dielectric(eta: f64, cosine: f64) -> f64 {
    let sine = (1.0 - cosine * cosine).sqrt() / eta;
    if sine >= 1.0 {
        return 1.0;
    }
    if cosine > 1.0 - 1e-9 {
        return ((eta - 1.0) / (eta + 1.0)).powi(2);
    }
    let (i, t) = (cosine.acos(), sine.asin());
    let rs = (i - t).sin() / (i + t).sin();
    let rp = (i - t).tan() / (i + t).tan();
    (rs * rs + rp * rp) / 2.0
}

/// Columns: two tangents and `normal`.
fn frame(normal: DVec3) -> glam::DMat3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    glam::DMat3::from_cols(tangent, bitangent, normal)
}

#[test]
fn quadratures_agree_with_closed_forms() {
    assert!(
        (Case::phong(8.0).phong_albedo(1) - 1.0).abs() < 1e-4,
        "Phong at normal incidence loses nothing"
    );
    assert!(
        (Case::blinn(8.0).blinn_albedo(1) - 1.0).abs() < 1e-3,
        "Blinn at normal incidence loses nothing"
    );
    assert!(
        (Case::metal(0.1).ggx_albedo(0) - 1.0).abs() < 2e-3,
        "a smooth white metal loses nothing"
    );
    let glass = Case::glass(0.05, 1.5);
    assert!(
        (glass.ggx_albedo(0) + glass.transmitted_albedo() - 1.0).abs() < 1e-4,
        "smooth glass loses nothing"
    );
    assert!((dielectric(1.5, 1.0) - 0.04).abs() < 1e-12);
    assert!((conductor(1.5, 0.0, 1.0) - 0.04).abs() < 1e-12);
}
