//! Parses the OBJ file itself: vertices, faces, and the material of each face.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::numbers::{any_numbers, numbers};
use crate::image::linear_from_srgb;
use crate::import::budget::Budget;
use crate::import::quoted;
use crate::import::replaced::{Broken, Replaced};
use crate::normals::replace_zero_normals;
use crate::tangents::unit_or;
use crate::{ImportError, Instance, Mesh, Name, origin, polygon};

/// The faces of one group (or object) that share a material.
pub struct Part {
    /// Named after the group; has no normals if any corner lacks one.
    pub mesh: Mesh,
    /// The material's name, if any.
    pub material: Option<Name>,
    /// Positions of the mesh in the file's coordinates (m).
    positions: Vec<DVec3>,
    /// New vertices, by position, texture coordinate and normal.
    vertices: HashMap<Corner, u32>,
    lacks_normals: bool,
}

/// Memory of an index (bytes).
const INDEX_BYTES: usize = 2 * size_of::<u32>();
/// Memory of a position, normal or texture coordinate (bytes), in a vector that may be twice as large as its contents.
const VALUE_BYTES: usize = 2 * size_of::<DVec3>();
/// Memory of a new vertex (bytes): its position in 64 bits and the table in which equal ones are found, which may be twice
/// as large as their contents; then its position in 32 bits, and a normal that it may be given.
const VERTEX_BYTES: usize = 2 * (size_of::<DVec3>() + size_of::<(Corner, u32)>()) + 24;
/// Memory of a vertex's normal, of its texture coordinate with a tangent, and of its colour (bytes), in files with any.
const NORMAL_BYTES: usize = 2 * size_of::<Vec3>();
const UV_BYTES: usize = 2 * size_of::<Vec2>() + size_of::<Vec4>();
const COLOR_BYTES: usize = 2 * size_of::<Vec4>();
/// Memory of a name (bytes), without its text: in a list and in a table that may be twice as large as their contents.
const NAME_BYTES: usize = 6 * size_of::<(Name, usize)>();
/// Memory of a part (bytes): its name, and itself as parsed, as a mesh, and as an instance.
const PART_BYTES: usize =
    Name::LONGEST + 2 * (size_of::<Part>() + size_of::<Mesh>() + size_of::<Instance>());

/// Indices of a position, a texture coordinate and a normal.
type Corner = (u32, Option<u32>, Option<u32>);

/// The contents of an OBJ file.
pub struct Geometry {
    /// Where the origin of the parts lies in the file's coordinates (m).
    pub origin: DVec3,
    /// Parts in file order.
    pub parts: Vec<Part>,
    /// The arguments of each `mtllib` line.
    pub libraries: Vec<String>,
    /// Features that the file uses and the importer does not support.
    pub warnings: Vec<String>,
}

impl Geometry {
    /// Parses `text`; errors name `file` and the line.
    pub fn parse(file: &str, text: &str, budget: &Budget) -> Result<Self, ImportError> {
        let mut parser = Parser::new(budget);
        for (number, line) in joined_lines(text) {
            parser
                .line(&line)
                .map_err(|reason| ImportError::new(file, format!("line {number}"), reason))?;
        }
        let color_scale = parser.color_scale();
        let mut replaced = parser.replaced;
        let mut parts = parser.parts;
        parts.retain(|part| !part.mesh.indices.is_empty());
        if parts.is_empty() {
            let reason = "there are no faces";
            return Err(ImportError::new(file, "whole file", reason));
        }
        let boxes = parts
            .iter()
            .filter_map(|part| origin::corners_of(part.positions.iter().copied()));
        let origin = origin::origin_of(boxes);
        for part in &mut parts {
            let positions = std::mem::take(&mut part.positions).into_iter();
            part.mesh.positions = positions
                .map(|position| (position - origin).as_vec3())
                .collect();
            if part.lacks_normals {
                part.mesh.normals.clear();
            }
            let count = replace_zero_normals(&mut part.mesh);
            replaced.add(Broken::Normal, count, &part.mesh.name);
            for color in &mut part.mesh.colors {
                let encoded = (color.truncate() * color_scale).to_array();
                *color = Vec3::from(encoded.map(linear_from_srgb)).extend(1.0);
            }
        }
        let ignored = parser.ignored.iter();
        Ok(Self {
            origin,
            parts,
            libraries: parser.libraries,
            warnings: ignored
                .map(|keyword| format!("OBJ statement \"{keyword}\" is not supported"))
                .chain(replaced.notes())
                .collect(),
        })
    }
}

/// Lines, each with the number of its first physical line. A backslash at the end continues a line.
fn joined_lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (index, line) = lines.next()?;
        let mut joined = Cow::Borrowed(line);
        while let Some(start) = joined.trim_end().strip_suffix('\\') {
            let length = start.len();
            let next = lines.next().map_or("", |(_, line)| line);
            // In place: copying the line each time would take quadratic time.
            let owned = joined.to_mut();
            owned.truncate(length);
            owned.push(' ');
            owned.push_str(next);
        }
        Some((index + 1, joined))
    })
}

/// What corners refer to by number.
#[derive(Default)]
struct Vertices {
    positions: Vec<DVec3>,
    /// Of the first positions; empty without any. White where there is none.
    colors: Vec<Vec3>,
    /// Unit vectors, or zero.
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
}

struct Parser<'a> {
    budget: &'a Budget,
    vertices: Vertices,
    replaced: Replaced,
    parts: Vec<Part>,
    /// Names of groups and materials, each once.
    names: Vec<Name>,
    number_of_name: HashMap<Name, usize>,
    /// By the numbers of the names of its group and its material.
    part_by_key: HashMap<(usize, Option<usize>), usize>,
    /// The part that receives faces; `None` after a change of group or material.
    current: Option<usize>,
    group: usize,
    material: Option<usize>,
    libraries: Vec<String>,
    ignored: BTreeSet<String>,
    corners: Vec<Corner>,
}

impl<'a> Parser<'a> {
    fn new(budget: &'a Budget) -> Self {
        Self {
            budget,
            vertices: Vertices::default(),
            replaced: Replaced::default(),
            parts: Vec::new(),
            names: vec![Name::default()],
            number_of_name: HashMap::from([(Name::default(), 0)]),
            part_by_key: HashMap::new(),
            current: None,
            group: 0,
            material: None,
            libraries: Vec::new(),
            ignored: BTreeSet::new(),
            corners: Vec::new(),
        }
    }

    fn line(&mut self, line: &str) -> Result<(), String> {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        // Names may contain a #; after numbers, it starts a comment.
        let (values, _) = rest.split_once('#').unwrap_or((rest, ""));
        let words = || values.split_whitespace().take(6).collect::<Vec<&str>>();
        if let "v" | "vn" | "vt" = keyword {
            self.budget.charge(1, VALUE_BYTES)?;
        }
        match keyword {
            "" | "s" => {}
            _ if keyword.starts_with('#') => {}
            "v" => {
                let words = words();
                self.vertices
                    .positions
                    .push(numbers::<f64, 3>(&words)?.into());
                if let [_, _, _, color @ ..] = &words[..]
                    && color.len() == 3
                {
                    self.color(any_numbers(color)?)?;
                }
            }
            "vn" => {
                let normal = any_numbers::<f32, 3>(&words())?.into();
                self.vertices.normals.push(unit_or(Vec3::ZERO, normal));
            }
            "vt" => {
                // v is optional and points up.
                let words = words();
                let [u] = any_numbers(&words)?;
                let [v] = words.get(1..2).map_or(Ok([0.0]), any_numbers)?;
                let mut uv = [[u, 1.0 - v]];
                (self.replaced).replace(&mut uv, Broken::Uv, [0.0; 2], "vt");
                self.vertices.uvs.push(uv[0].into());
            }
            "f" => self.face(values)?,
            "o" | "g" => {
                self.group = self.name(rest)?;
                self.current = None;
            }
            "usemtl" => {
                self.material = Some(self.name(rest)?);
                self.current = None;
            }
            "mtllib" => self.libraries.push(rest.to_owned()),
            // Limited, because a damaged file could hold any number of unknown words.
            _ if self.ignored.len() < 20 => {
                self.ignored.insert(quoted(keyword));
            }
            _ => {}
        }
        Ok(())
    }

    /// Gives the last vertex a colour.
    fn color(&mut self, color: [f32; 3]) -> Result<(), String> {
        let Vertices {
            positions, colors, ..
        } = &mut self.vertices;
        let new = positions.len() - colors.len();
        self.budget.charge(new as u64, VALUE_BYTES)?;
        colors.resize(positions.len() - 1, Vec3::ONE);
        let mut color = [color];
        (self.replaced).replace(&mut color, Broken::Color, [1.0; 3], "v");
        colors.push(color[0].into());
        Ok(())
    }

    /// Colours reach from 0 to 1, or to 255 in files of some scanners.
    fn color_scale(&self) -> f32 {
        let colors = self.vertices.colors.iter();
        let largest = colors.fold(0.0, |largest: f32, color| largest.max(color.max_element()));
        if largest > 1.0 { 1.0 / 255.0 } else { 1.0 }
    }

    fn face(&mut self, values: &str) -> Result<(), String> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        for word in values.split_whitespace() {
            corners.push(self.corner(word)?);
        }
        if corners.len() < 3 {
            return Err(format!("a face with {} corners", corners.len()));
        }
        self.budget
            .charge(corners.len() as u64 - 2, 3 * INDEX_BYTES)?;
        let corner = |&(position, ..): &Corner| self.vertices.positions[position as usize];
        let positions: Vec<DVec3> = corners.iter().map(corner).collect();
        let positions = origin::near(&positions);
        let too_large = usize::from(polygon::is_too_large(&positions));
        self.replaced.add(Broken::Face, too_large, "f");
        let triangles = polygon::triangulate(&positions);
        let current = self.current_part()?;
        let part = &mut self.parts[current];
        let before = part.counts();
        let vertices: Vec<u32> = corners
            .iter()
            .map(|&corner| part.vertex(corner, &self.vertices))
            .collect();
        let counts = part.counts().into_iter().zip(before);
        let bytes = [VERTEX_BYTES, NORMAL_BYTES, UV_BYTES, COLOR_BYTES];
        for ((count, before), bytes) in counts.zip(bytes) {
            self.budget.charge((count - before) as u64, bytes)?;
        }
        for triangle in triangles {
            let triangle = triangle.map(|corner| vertices[corner as usize]);
            part.mesh.indices.extend(triangle);
        }
        self.corners = corners;
        Ok(())
    }

    /// `position`, `position/uv`, `position//normal` or `position/uv/normal`; counted from 1, or backward from -1.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut fields = word.split('/');
        let mut next = |what: &str, count: usize| {
            let field = fields.next().unwrap_or_default();
            if field.is_empty() {
                return Ok(None);
            }
            let number: i64 = field
                .parse()
                .map_err(|_| format!("\"{}\" is no face corner", quoted(word)))?;
            let index = if number < 0 {
                number.saturating_add(count as i64)
            } else {
                number - 1
            };
            if !(0..count as i64).contains(&index) {
                return Err(format!(
                    "{what} {number} does not exist: there are {count} so far"
                ));
            }
            Ok(Some(index as u32))
        };
        let position = next("vertex", self.vertices.positions.len())?;
        let uv = next("texture coordinate", self.vertices.uvs.len())?;
        let normal = next("normal", self.vertices.normals.len())?;
        let position = position.ok_or_else(|| format!("\"{}\" names no vertex", quoted(word)))?;
        Ok((position, uv, normal))
    }

    /// The number of a name. Long names are compared once for each line that has them, not for each part.
    fn name(&mut self, name: &str) -> Result<usize, String> {
        if let Some(&number) = self.number_of_name.get(name) {
            return Ok(number);
        }
        self.budget.charge(1, NAME_BYTES + name.len())?;
        let name = Name::from(name);
        self.number_of_name.insert(name.clone(), self.names.len());
        self.names.push(name);
        Ok(self.names.len() - 1)
    }

    fn current_part(&mut self) -> Result<usize, String> {
        if let Some(current) = self.current {
            return Ok(current);
        }
        let key = (self.group, self.material);
        let current = if let Some(&known) = self.part_by_key.get(&key) {
            known
        } else {
            self.budget.charge(1, PART_BYTES)?;
            let material = self.material.map(|number| self.names[number].clone());
            let group = &self.names[self.group];
            let of_material = material.clone().unwrap_or_else(|| "default".into());
            let name = if group.is_empty() {
                of_material
            } else {
                group.with(&format!(" ({of_material})"))
            };
            self.part_by_key.insert(key, self.parts.len());
            self.parts.push(Part {
                mesh: Mesh {
                    name,
                    ..Mesh::default()
                },
                material,
                positions: Vec::new(),
                vertices: HashMap::new(),
                lacks_normals: false,
            });
            self.parts.len() - 1
        };
        self.current = Some(current);
        Ok(current)
    }
}

/// Adds what vertex `number` has to a list that stays empty until a vertex has any; those without have `none`.
fn push_if_any<T: Copy>(list: &mut Vec<T>, number: usize, value: Option<T>, none: T) {
    if value.is_some() || !list.is_empty() {
        list.resize(number, none);
        list.push(value.unwrap_or(none));
    }
}

impl Part {
    /// Numbers of vertices, and of their normals, texture coordinates and colours.
    fn counts(&self) -> [usize; 4] {
        let Mesh {
            normals,
            uvs,
            colors,
            ..
        } = &self.mesh;
        let positions = self.positions.len();
        [positions, normals.len(), uvs[0].len(), colors.len()]
    }

    fn vertex(&mut self, corner: Corner, vertices: &Vertices) -> u32 {
        let (position, uv, normal) = corner;
        let mesh = &mut self.mesh;
        *self.vertices.entry(corner).or_insert_with(|| {
            let number = self.positions.len();
            self.positions.push(vertices.positions[position as usize]);
            let color = vertices.colors.get(position as usize);
            let color = color.map(|color| color.extend(1.0));
            push_if_any(&mut mesh.colors, number, color, Vec4::ONE);
            let uv = uv.map(|uv| vertices.uvs[uv as usize]);
            push_if_any(&mut mesh.uvs[0], number, uv, Vec2::ZERO);
            let normal = normal.map(|normal| vertices.normals[normal as usize]);
            self.lacks_normals |= normal.is_none();
            push_if_any(&mut mesh.normals, number, normal, Vec3::ZERO);
            number as u32
        })
    }
}
