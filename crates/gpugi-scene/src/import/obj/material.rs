//! MTL materials.

use std::collections::{BTreeSet, HashMap, HashSet};

use glam::Vec3;

use super::displace::Relief;
use super::numbers::numbers;
use super::texture::{Map, Textures};
use crate::import::budget::Budget;
use crate::import::quoted;
use crate::import::text::without_mark;
use crate::{AlphaMode, ImportError, Material, MaterialModel, Resolver, Scene};

/// The materials of all libraries that an OBJ file refers to.
pub struct Library<'a> {
    resolver: &'a dyn Resolver,
    budget: &'a Budget,
    textures: Textures<'a>,
    by_name: HashMap<String, usize>,
    /// Of the materials that displace their surfaces.
    reliefs: HashMap<usize, Relief>,
    /// The arguments and files that have been read.
    known: HashSet<String>,
}

/// A material as described by MTL.
#[derive(Default)]
struct Entry {
    name: String,
    kd: Option<Vec3>,
    ks: Vec3,
    ke: Option<Vec3>,
    shininess: Option<f32>,
    alpha: Option<f32>,
    /// 1 - alpha, which some exporters write instead of alpha.
    transparency: Option<f32>,
    roughness: Option<f32>,
    metallic: Option<f32>,
    ior: Option<f32>,
    illumination: Option<f32>,
    maps: HashMap<&'static str, Map>,
}

/// Memory of a material (bytes), as parsed and in the scene, without its names.
const MATERIAL_BYTES: usize = 2 * size_of::<Entry>() + 2 * size_of::<Material>();

/// Supported maps: keywords, and what stands for them.
const MAPS: [(&str, &str); 10] = [
    ("map_Kd", "map_Kd"),
    ("map_Ke", "map_Ke"),
    ("map_d", "map_d"),
    ("norm", "norm"),
    ("bump", "bump"),
    ("map_bump", "bump"),
    ("map_Bump", "bump"),
    ("disp", "disp"),
    ("map_disp", "disp"),
    ("map_Disp", "disp"),
];
/// The strongest normal maps: numbers beyond would overflow in shaders.
const STRONGEST: f32 = 1000.0;

impl<'a> Library<'a> {
    pub fn new(resolver: &'a dyn Resolver, budget: &'a Budget) -> Self {
        Self {
            resolver,
            budget,
            textures: Textures::new(resolver, budget),
            by_name: HashMap::new(),
            reliefs: HashMap::new(),
            known: HashSet::new(),
        }
    }

    /// Index of the material called `name` in the scene.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// How far surfaces of a material of the scene rise along their normals, if they do.
    pub fn relief(&self, material: usize) -> Option<&Relief> {
        self.reliefs.get(&material)
    }

    /// Adds the libraries of a `mtllib` line to the scene. The line holds either one name, possibly with spaces, or
    /// several names. What has been read is not read again.
    pub fn load(&mut self, names: &str, scene: &mut Scene) -> Result<(), ImportError> {
        let whole = names.replace('\\', "/");
        if !self.known.insert(whole.clone()) {
            return Ok(());
        }
        if let Ok(bytes) = self.resolver.read(&whole) {
            return self.read(&whole, &bytes, scene);
        }
        for file in whole.split_whitespace() {
            if file != whole && !self.known.insert(file.to_owned()) {
                continue;
            }
            match self.resolver.read(file) {
                Ok(bytes) => self.read(file, &bytes, scene)?,
                Err(reason) => {
                    let file = quoted(file);
                    let warning = format!("material library {file}: {reason}");
                    scene.warnings.push(warning);
                }
            }
        }
        Ok(())
    }

    fn read(&mut self, file: &str, bytes: &[u8], scene: &mut Scene) -> Result<(), ImportError> {
        self.budget.give(file, bytes.len());
        let bytes = match without_mark(bytes) {
            Ok(bytes) => bytes,
            Err(reason) => {
                let warning = format!("material library {}: {reason}", quoted(file));
                scene.warnings.push(warning);
                return Ok(());
            }
        };
        let text = String::from_utf8_lossy(bytes);
        let mut entries: Vec<Entry> = Vec::new();
        let mut ignored = BTreeSet::new();
        for (index, line) in text.lines().enumerate() {
            let line = line.trim();
            let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            let rest = rest.trim();
            if keyword == "newmtl" {
                let charged = self.budget.charge(1, MATERIAL_BYTES + 3 * rest.len());
                charged.map_err(|reason| {
                    ImportError::new(file, format!("line {}", index + 1), reason)
                })?;
                entries.push(Entry {
                    name: rest.to_owned(),
                    ..Entry::default()
                });
            } else if let Some(entry) = entries.last_mut() {
                let known = entry.statement(keyword, rest).map_err(|reason| {
                    ImportError::new(file, format!("line {}", index + 1), reason)
                })?;
                if !known && ignored.len() < 20 {
                    ignored.insert(quoted(keyword));
                }
            }
        }
        for keyword in ignored {
            let warning = format!("{file}: MTL statement \"{keyword}\" is not supported");
            scene.warnings.push(warning);
        }
        for entry in entries {
            let name = entry.name.clone();
            entry.note_broken_maps(scene);
            let relief = entry.relief(&mut self.textures, self.budget, scene);
            let material = entry.material(&mut self.textures, relief.as_ref(), scene);
            let material = scene.add_material(material);
            if let Some(relief) = relief {
                self.reliefs.insert(material, relief);
            }
            self.by_name.insert(name, material);
        }
        Ok(())
    }
}

impl Entry {
    /// Parses one statement; returns `false` if it is not supported.
    fn statement(&mut self, keyword: &str, rest: &str) -> Result<bool, String> {
        // Names may contain a #; after numbers, it starts a comment.
        let (values, _) = rest.split_once('#').unwrap_or((rest, ""));
        let words: Vec<&str> = values.split_whitespace().take(4).collect();
        let one = || numbers::<f32, 1>(&words).map(|[value]| Some(value));
        match keyword {
            // The ambient colour is ignored: there are no ambient lights.
            "" | "Ka" => {}
            _ if keyword.starts_with('#') => {}
            "Kd" => self.kd = Some(color(&words)?),
            "Ks" => self.ks = color(&words)?,
            "Ke" => self.ke = Some(color(&words)?),
            "Ns" => self.shininess = one()?,
            "d" => self.alpha = one()?,
            "Tr" => self.transparency = one()?,
            "Pr" => self.roughness = one()?,
            "Pm" => self.metallic = one()?,
            "Ni" => self.ior = one()?,
            "illum" => self.illumination = one()?,
            _ => {
                let Some((_, map)) = MAPS.iter().find(|(known, _)| *known == keyword) else {
                    return Ok(false);
                };
                self.maps.insert(map, Map::parse(rest));
            }
        }
        Ok(true)
    }

    fn note_broken_maps(&self, scene: &mut Scene) {
        let mut broken: Vec<_> = self.maps.iter().filter(|(_, map)| map.is_broken).collect();
        broken.sort_by_key(|(keyword, _)| **keyword);
        for (keyword, _) in broken {
            let name = quoted(&self.name);
            let warning = format!(
                "material \"{name}\": numbers of {keyword} that are not finite are ignored"
            );
            scene.warnings.push(warning);
        }
    }

    /// What `disp` says; `None`, with a warning, if it cannot be read or is not allowed.
    fn relief(
        &self,
        textures: &mut Textures,
        budget: &Budget,
        scene: &mut Scene,
    ) -> Option<Relief> {
        let map = self.maps.get("disp")?;
        if !budget.displaces() {
            let name = quoted(&self.name);
            let warning = format!(
                "material \"{name}\": its displacement is left out; --limits displacement=N allows it"
            );
            scene.warnings.push(warning);
            return None;
        }
        let levels = textures.heights(&map.file, scene)?;
        Some(Relief {
            levels,
            map: map.clone(),
        })
    }

    fn material(
        &self,
        textures: &mut Textures,
        relief: Option<&Relief>,
        scene: &mut Scene,
    ) -> Material {
        let map = |name: &str| self.maps.get(name);
        let alpha = self
            .alpha
            .or(self.transparency.map(|transparency| 1.0 - transparency))
            .unwrap_or(1.0)
            .clamp(0.0, 1.0);
        // With a map but no factor, the factor is 1.
        let without = if map("map_Kd").is_some() { 1.0 } else { 0.6 };
        let kd = self.kd.unwrap_or(Vec3::splat(without));
        let kd = kd.clamp(Vec3::ZERO, Vec3::ONE);

        let mut material = self.reflection(kd, scene);
        material.name = self.name.clone();
        material.base_color.w = alpha;
        material.base_color_texture = match map("map_d") {
            Some(coverage) => textures.with_alpha(map("map_Kd"), coverage, scene),
            None => map("map_Kd").and_then(|map| textures.texture(map, scene)),
        };
        if alpha < 1.0 || (map("map_d").is_some() && material.base_color_texture.is_some()) {
            material.alpha_mode = AlphaMode::Blend;
        }
        let without = if map("map_Ke").is_some() { 1.0 } else { 0.0 };
        material.emissive = self.ke.unwrap_or(Vec3::splat(without)).max(Vec3::ZERO);
        material.emissive_texture = map("map_Ke").and_then(|map| textures.texture(map, scene));
        // What has been displaced by an image would slope twice if its normals did, too.
        let is_displaced = |map: &&Map| relief.is_some_and(|relief| relief.map.file == map.file);
        let bump = map("bump").filter(|map| !is_displaced(map));
        let normals = match map("norm") {
            Some(map) => textures
                .texture(map, scene)
                .map(|texture| (texture, map.strength)),
            None => bump.and_then(|map| textures.bump(map, scene)),
        };
        if let Some((texture, scale)) = normals {
            material.normal_texture = Some(texture);
            material.normal_scale = scale.clamp(-STRONGEST, STRONGEST);
            if scale.abs() > STRONGEST {
                let name = quoted(&self.name);
                let warning = format!(
                    "material \"{name}\": a normal map of strength {scale} has {STRONGEST}, the most"
                );
                scene.warnings.push(warning);
            }
        }
        material
    }

    /// Metallic-roughness if the statements of the physically based extension are present, Phong if the material is
    /// specular, otherwise matt.
    fn reflection(&self, kd: Vec3, scene: &mut Scene) -> Material {
        if self.roughness.is_some() || self.metallic.is_some() {
            return Material {
                base_color: kd.extend(1.0),
                roughness: self.roughness.unwrap_or(1.0).clamp(0.0, 1.0),
                metallic: self.metallic.unwrap_or(0.0).clamp(0.0, 1.0),
                ior: self.ior.filter(|ior| *ior >= 1.0).unwrap_or(1.5),
                ..Material::default()
            };
        }
        let ks = self.ks.max(Vec3::ZERO);
        // Illumination models 0 and 1 have no specular term.
        let is_specular = ks != Vec3::ZERO && self.illumination.is_none_or(|model| model >= 2.0);
        if !is_specular {
            return Material::matt("", kd);
        }
        let largest = (kd + ks).max_element();
        if largest > 1.0 {
            let name = quoted(&self.name);
            let warning = format!(
                "material \"{name}\": Kd + Ks is {largest}, which would make light; both are scaled to 1"
            );
            scene.warnings.push(warning);
        }
        let scale = 1.0 / largest.max(1.0);
        Material {
            model: MaterialModel::Phong {
                kd: kd * scale,
                ks: ks * scale,
                shininess: self.shininess.unwrap_or(10.0).max(0.0),
            },
            ..Material::default()
        }
    }
}

/// A single number applies to all three channels; spectra and CIE XYZ are not supported.
fn color(words: &[&str]) -> Result<Vec3, String> {
    match *words {
        ["spectral" | "xyz", ..] => Err("only RGB colours are supported".into()),
        [one] => numbers::<f32, 1>(&[one]).map(|[value]| Vec3::splat(value)),
        _ => numbers(words).map(Vec3::from_array),
    }
}
