//! PLY: a single mesh, ASCII or binary in either byte order.
//!
//! The parser is custom so that counts in a file are never trusted before the file has proved long enough for them,
//! errors name their place, and hundreds of thousands of vertices do not each become a map of named properties.

mod header;
mod values;

use std::collections::HashMap;

use glam::{DVec3, Mat4, Vec3, Vec4};

use self::header::{Element, Header, Kind, Property};
use self::values::Values;
use super::budget::Budget;
use super::default_material;
use super::replaced::{Broken, Replaced};
use super::text::without_mark;
use crate::image::linear_from_srgb;
use crate::normals::replace_zero_normals;
use crate::tangents::unit_or;
use crate::{ImportError, Limits, Mesh, Scene, origin, polygon};

/// Reads a PLY mesh. Positions and faces are required; normals (smooth ones are generated if missing), texture
/// coordinates and colours of vertices or faces are optional. Other elements and properties are skipped.
pub fn import(name: &str, bytes: &[u8], limits: &Limits) -> Result<Scene, ImportError> {
    let bytes = without_mark(bytes).map_err(|reason| ImportError::new(name, "line 1", reason))?;
    let header = Header::parse(bytes)
        .map_err(|(line, reason)| ImportError::new(name, format!("line {line}"), reason))?;
    let mut values = Values::new(&bytes[header.size..], header.format);
    let mut scene = Scene::new(name);
    let budget = Budget::new(limits, bytes.len());
    let mut mesh =
        read(&header, &mut values, &budget, &mut scene.warnings).map_err(|error| match error {
            Failure::Place(place, reason) => ImportError::new(name, place, reason),
            Failure::Here(reason) => ImportError::new(name, values.place(bytes), reason),
        })?;

    // The only mesh has the place of the scene.
    scene.origin = std::mem::take(&mut mesh.origin);
    let bounds = mesh.bounds();
    let corners = [bounds.min, bounds.max].map(|corner| corner.as_dvec3() + scene.origin);
    if let Some(step) = origin::coarse_step(corners).filter(|_| stores_32_bits(&header)) {
        let warning = format!("element vertex: {}", origin::coarse_positions(step));
        scene.warnings.push(warning);
    }
    let stem = std::path::Path::new(name).file_stem();
    let stem = stem.map_or_else(|| "mesh".into(), |stem| stem.to_string_lossy().into_owned());
    let material = scene.add_material(default_material(!mesh.colors.is_empty()));
    let mesh = scene.add_mesh(Mesh {
        name: stem.clone().into(),
        ..mesh
    });
    scene.add_instance(&stem, mesh, material, Mat4::IDENTITY);
    Ok(scene)
}

/// Whether positions are 32-bit floats.
fn stores_32_bits(header: &Header) -> bool {
    let vertices = header
        .elements
        .iter()
        .filter(|element| element.name == "vertex");
    let mut properties = vertices.flat_map(|element| &element.properties);
    properties.any(|property| {
        matches!(Role::of(property), Role::Position(_)) && matches!(property.kind, Kind::F32)
    })
}

/// Why a file is rejected: at a named place, or at the current position of the reader.
enum Failure {
    Place(String, String),
    Here(String),
}

impl From<String> for Failure {
    fn from(reason: String) -> Self {
        Self::Here(reason)
    }
}

/// Memory of a vertex (bytes): position as read and as kept, normal, texture coordinate and colour, in vectors that may
/// be twice as large as their contents.
const VERTEX_BYTES: usize = 2 * (24 + 12 + 12 + 8 + 16);
/// Memory of an index (bytes), likewise.
const INDEX_BYTES: usize = 2 * size_of::<u32>();

/// Memory of a vertex that has the colour of a face (bytes): with its place in the table in which equal ones are found,
/// and in a list of their origins.
const COLORED_BYTES: usize =
    VERTEX_BYTES + 2 * (size_of::<((u32, [u32; 4]), u32)>() + size_of::<u32>());

fn read(
    header: &Header,
    values: &mut Values,
    budget: &Budget,
    warnings: &mut Vec<String>,
) -> Result<Mesh, Failure> {
    let mut mesh = Mesh::default();
    let mut replaced = Replaced::default();
    let mut has_faces = false;
    for element in &header.elements {
        let place = format!("element {}", element.name);
        values
            .expect(element)
            .map_err(|reason| Failure::Place(place.clone(), reason))?;
        match element.name.as_str() {
            "vertex" => {
                let charged = budget.charge(element.count, VERTEX_BYTES);
                charged.map_err(|reason| Failure::Place(place, reason))?;
                read_vertices(element, values, &mut mesh, &mut replaced)?;
            }
            "face" if has_faces => {
                return Err(Failure::Place(place, "there are two of them".into()));
            }
            "face" => {
                has_faces = true;
                read_faces(element, values, &mut mesh, &mut replaced, budget)?;
            }
            "tristrips" => {
                let reason = "triangle strips are not supported: convert them to faces";
                return Err(Failure::Place(place, reason.into()));
            }
            _ => skip(element, values)?,
        }
    }
    if mesh.positions.is_empty() || !has_faces {
        let reason = "there is no mesh: it takes an element vertex and an element face";
        return Err(Failure::Place("header".into(), reason.into()));
    }
    if mesh.indices.is_empty() {
        let reason = "there are no triangles";
        return Err(Failure::Place("element face".into(), reason.into()));
    }
    if mesh.normals.is_empty() {
        let smoothed = budget.smooth_normals(&mut mesh);
        smoothed.map_err(|reason| Failure::Place("element face".into(), reason))?;
    }
    let count = replace_zero_normals(&mut mesh);
    replaced.add(Broken::Normal, count, "element vertex");
    warnings.extend(replaced.notes());
    Ok(mesh)
}

/// The purpose of a property of a vertex, or of a face, which only has a colour.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Role {
    Position(usize),
    Normal(usize),
    Uv(usize),
    Color(usize),
    Other,
}

impl Role {
    fn of(property: &Property) -> Self {
        match property.name.as_str() {
            "x" => Self::Position(0),
            "y" => Self::Position(1),
            "z" => Self::Position(2),
            "nx" => Self::Normal(0),
            "ny" => Self::Normal(1),
            "nz" => Self::Normal(2),
            "u" | "s" | "texture_u" => Self::Uv(0),
            "v" | "t" | "texture_v" => Self::Uv(1),
            "red" | "r" | "diffuse_red" => Self::Color(0),
            "green" | "g" | "diffuse_green" => Self::Color(1),
            "blue" | "b" | "diffuse_blue" => Self::Color(2),
            "alpha" | "a" => Self::Color(3),
            _ => Self::Other,
        }
    }
}

fn read_vertices(
    element: &Element,
    values: &mut Values,
    mesh: &mut Mesh,
    replaced: &mut Replaced,
) -> Result<(), Failure> {
    let roles: Vec<Role> = element.properties.iter().map(Role::of).collect();
    let has = |role: fn(usize) -> Role, count: usize| (0..count).all(|i| roles.contains(&role(i)));
    if !has(Role::Position, 3) {
        let reason = "the properties x, y and z are required";
        return Err(Failure::Place("element vertex".into(), reason.into()));
    }
    let has_normals = has(Role::Normal, 3);
    let has_uvs = has(Role::Uv, 2);
    let has_colors = has(Role::Color, 3);

    let mut positions = Vec::new();
    for _ in 0..element.count {
        let (mut position, mut normal, mut uv) = (DVec3::ZERO, Vec3::ZERO, [0.0; 2]);
        let mut color = [1.0; 4];
        for (property, role) in element.properties.iter().zip(&roles) {
            if property.list_count.is_some() {
                skip_property(property, values)?;
                continue;
            }
            let value = values.number(property.kind)?;
            match *role {
                Role::Other => {}
                Role::Position(axis) => {
                    position[axis] = value;
                    if !(value as f32).is_finite() {
                        return Err(format!("property {} is not finite", property.name).into());
                    }
                }
                Role::Normal(axis) => normal[axis] = value as f32,
                Role::Uv(axis) => uv[axis] = value as f32,
                Role::Color(channel) => {
                    color[channel] = linear_color(value, property.kind, channel == 3);
                }
            }
        }
        positions.push(position);
        if has_normals {
            mesh.normals.push(unit_or(Vec3::ZERO, normal));
        }
        if has_uvs {
            // In PLY, v points up.
            let mut uv = [[uv[0], 1.0 - uv[1]]];
            replaced.replace(&mut uv, Broken::Uv, [0.0; 2], "element vertex");
            mesh.uvs[0].push(uv[0].into());
        }
        if has_colors {
            mesh.colors
                .push(finite_color(color, replaced, "element vertex"));
        }
    }
    mesh.origin = origin::origin_of(origin::corners_of(positions.iter().copied()));
    let positions = positions.into_iter();
    mesh.positions = positions
        .map(|position| (position - mesh.origin).as_vec3())
        .collect();
    Ok(())
}

fn finite_color(color: [f32; 4], replaced: &mut Replaced, place: &str) -> Vec4 {
    let mut color = [color];
    replaced.replace(&mut color, Broken::Color, [1.0; 4], place);
    color[0].into()
}

/// Integers are sRGB over the range of their type, floats are linear; alpha is always linear.
fn linear_color(value: f64, kind: Kind, is_alpha: bool) -> f32 {
    let Some(largest) = kind.largest() else {
        return value as f32;
    };
    let encoded = (value / largest).clamp(0.0, 1.0) as f32;
    if is_alpha {
        encoded
    } else {
        linear_from_srgb(encoded)
    }
}

fn read_faces(
    element: &Element,
    values: &mut Values,
    mesh: &mut Mesh,
    replaced: &mut Replaced,
    budget: &Budget,
) -> Result<(), Failure> {
    let is_corner_list = |property: &Property| {
        property.list_count.is_some()
            && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
    };
    let Some(corner_list) = element.properties.iter().position(is_corner_list) else {
        let reason = "a list property vertex_indices or vertex_index is required";
        return Err(Failure::Place("element face".into(), reason.into()));
    };
    if mesh.positions.is_empty() && element.count > 0 {
        let reason = "faces come before the vertices, or there are none";
        return Err(Failure::Place("element face".into(), reason.into()));
    }
    let roles: Vec<Role> = element.properties.iter().map(Role::of).collect();
    let mut colored = Colored::default();
    // Colours of vertices say more than those of faces.
    let has_colors =
        mesh.colors.is_empty() && (0..3).all(|channel| roles.contains(&Role::Color(channel)));
    let mut corners = Vec::new();
    for _ in 0..element.count {
        let mut color = [1.0; 4];
        for (at, (property, role)) in element.properties.iter().zip(&roles).enumerate() {
            match *role {
                _ if at == corner_list => {
                    read_corners(property, values, mesh.positions.len(), &mut corners)?;
                }
                Role::Color(channel) if property.list_count.is_none() => {
                    let value = values.number(property.kind)?;
                    color[channel] = linear_color(value, property.kind, channel == 3);
                }
                _ => skip_property(property, values)?,
            }
        }
        budget.charge(corners.len().saturating_sub(2) as u64, 3 * INDEX_BYTES)?;
        let first = mesh.indices.len();
        add_polygon(mesh, &corners, replaced);
        if has_colors {
            budget.charge(corners.len() as u64, COLORED_BYTES)?;
            let color = finite_color(color, replaced, "element face");
            (mesh.indices[first..].iter_mut())
                .for_each(|vertex| *vertex = colored.vertex(*vertex, color));
        }
    }
    if has_colors {
        let indices = std::mem::take(&mut mesh.indices);
        *mesh = mesh.with_vertices(&colored.sources, indices);
        mesh.colors = colored.colors;
    }
    Ok(())
}

/// Vertices that have the colours of their faces: one for each colour around a vertex of the file.
#[derive(Default)]
struct Colored {
    number_of: HashMap<(u32, [u32; 4]), u32>,
    /// The vertex of the file.
    sources: Vec<u32>,
    colors: Vec<Vec4>,
}

impl Colored {
    fn vertex(&mut self, source: u32, color: Vec4) -> u32 {
        let key = (source, color.to_array().map(f32::to_bits));
        *self.number_of.entry(key).or_insert_with(|| {
            self.sources.push(source);
            self.colors.push(color);
            self.sources.len() as u32 - 1
        })
    }
}

/// Reads the corners of a face; each is below `vertices`.
fn read_corners(
    property: &Property,
    values: &mut Values,
    vertices: usize,
    corners: &mut Vec<u32>,
) -> Result<(), Failure> {
    corners.clear();
    for _ in 0..values.list_count(property)? {
        let index = values.number(property.kind)?;
        if !(index >= 0.0 && index < vertices as f64 && index.fract() == 0.0) {
            let reason =
                format!("vertex index {index} is out of range: there are {vertices} vertices");
            return Err(reason.into());
        }
        corners.push(index as u32);
    }
    Ok(())
}

fn add_polygon(mesh: &mut Mesh, corners: &[u32], replaced: &mut Replaced) {
    if let [a, b, c] = *corners {
        mesh.indices.extend([a, b, c]);
        return;
    }
    let positions: Vec<Vec3> = corners
        .iter()
        .map(|&corner| mesh.positions[corner as usize])
        .collect();
    let too_large = usize::from(polygon::is_too_large(&positions));
    replaced.add(Broken::Face, too_large, "element face");
    for triangle in polygon::triangulate(&positions) {
        let vertices = triangle.map(|corner| corners[corner as usize]);
        mesh.indices.extend(vertices);
    }
}

fn skip(element: &Element, values: &mut Values) -> Result<(), Failure> {
    // Without properties there is nothing to read, however many entries the header claims.
    let count = if element.properties.is_empty() {
        0
    } else {
        element.count
    };
    for _ in 0..count {
        for property in &element.properties {
            skip_property(property, values)?;
        }
    }
    Ok(())
}

fn skip_property(property: &Property, values: &mut Values) -> Result<(), Failure> {
    let count = match property.list_count {
        None => 1,
        Some(_) => values.list_count(property)?,
    };
    for _ in 0..count {
        values.number(property.kind)?;
    }
    Ok(())
}
