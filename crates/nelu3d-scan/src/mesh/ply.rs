//! PLY (Greg Turk, 1994): the format most scanning tools exchange. Read here rather than by a crate, because meshes of
//! millions of vertices go through it and hostile headers must not allocate.

use std::io::{self, Write};

use super::model::{Mesh, push_polygon};

pub(super) fn write(mesh: &Mesh, w: &mut dyn Write) -> io::Result<()> {
    write_parts(&mesh.vertices, &mesh.normals, &mesh.colors, &[], &mesh.faces, w)
}

/// Writes binary little-endian PLY. Without faces there is no face element: a point cloud.
pub(super) fn write_parts(
    vertices: &[[f32; 3]],
    normals: &[[f32; 3]],
    colors: &[[u8; 3]],
    sigma: &[f32],
    faces: &[[u32; 3]],
    w: &mut dyn Write,
) -> io::Result<()> {
    writeln!(w, "ply\nformat binary_little_endian 1.0\ncomment nelu3d: mm, camera frame (x right, y down, z forward)")?;
    writeln!(w, "element vertex {}\nproperty float x\nproperty float y\nproperty float z", vertices.len())?;
    if !normals.is_empty() {
        writeln!(w, "property float nx\nproperty float ny\nproperty float nz")?;
    }
    if !colors.is_empty() {
        writeln!(w, "property uchar red\nproperty uchar green\nproperty uchar blue")?;
    }
    if !sigma.is_empty() {
        writeln!(w, "property float sigma")?;
    }
    if !faces.is_empty() {
        writeln!(w, "element face {}\nproperty list uchar int vertex_indices", faces.len())?;
    }
    writeln!(w, "end_header")?;
    for (i, v) in vertices.iter().enumerate() {
        for c in v.iter().chain(normals.get(i).into_iter().flatten()) {
            w.write_all(&c.to_le_bytes())?;
        }
        if let Some(color) = colors.get(i) {
            w.write_all(color)?;
        }
        if let Some(sigma) = sigma.get(i) {
            w.write_all(&sigma.to_le_bytes())?;
        }
    }
    for face in faces {
        w.write_all(&[3])?;
        for i in face {
            w.write_all(&i.to_le_bytes())?;
        }
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn from_name(name: &str) -> Result<Self, String> {
        Ok(match name {
            "char" | "int8" => Type::I8,
            "uchar" | "uint8" => Type::U8,
            "short" | "int16" => Type::I16,
            "ushort" | "uint16" => Type::U16,
            "int" | "int32" => Type::I32,
            "uint" | "uint32" => Type::U32,
            "float" | "float32" => Type::F32,
            "double" | "float64" => Type::F64,
            other => return Err(format!("its header has the unknown type {other}")),
        })
    }

    fn is_float(self) -> bool {
        matches!(self, Type::F32 | Type::F64)
    }
}

struct Property {
    name: String,
    /// Type of the length, for a list.
    list: Option<Type>,
    kind: Type,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// The values after the header. Every kind of number PLY has is exact as `f64`.
enum Body<'a> {
    Ascii(std::str::SplitAsciiWhitespace<'a>),
    Little(&'a [u8]),
    Big(&'a [u8]),
}

impl Body<'_> {
    fn next(&mut self, kind: Type) -> Result<f64, String> {
        match self {
            Body::Ascii(words) => {
                let word = words.next().ok_or("it is truncated")?;
                word.parse().map_err(|_| format!("`{word}` is not a number"))
            }
            Body::Little(bytes) => match kind {
                Type::I8 => take(bytes).map(|b| f64::from(i8::from_le_bytes(b))),
                Type::U8 => take(bytes).map(|b| f64::from(u8::from_le_bytes(b))),
                Type::I16 => take(bytes).map(|b| f64::from(i16::from_le_bytes(b))),
                Type::U16 => take(bytes).map(|b| f64::from(u16::from_le_bytes(b))),
                Type::I32 => take(bytes).map(|b| f64::from(i32::from_le_bytes(b))),
                Type::U32 => take(bytes).map(|b| f64::from(u32::from_le_bytes(b))),
                Type::F32 => take(bytes).map(|b| f64::from(f32::from_le_bytes(b))),
                Type::F64 => take(bytes).map(f64::from_le_bytes),
            },
            Body::Big(bytes) => match kind {
                Type::I8 => take(bytes).map(|b| f64::from(i8::from_be_bytes(b))),
                Type::U8 => take(bytes).map(|b| f64::from(u8::from_be_bytes(b))),
                Type::I16 => take(bytes).map(|b| f64::from(i16::from_be_bytes(b))),
                Type::U16 => take(bytes).map(|b| f64::from(u16::from_be_bytes(b))),
                Type::I32 => take(bytes).map(|b| f64::from(i32::from_be_bytes(b))),
                Type::U32 => take(bytes).map(|b| f64::from(u32::from_be_bytes(b))),
                Type::F32 => take(bytes).map(|b| f64::from(f32::from_be_bytes(b))),
                Type::F64 => take(bytes).map(f64::from_be_bytes),
            },
        }
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], String> {
    let (first, rest) = bytes.split_first_chunk().ok_or("it is truncated")?;
    *bytes = rest;
    Ok(*first)
}

pub(super) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    let (elements, mut body) = parse_header(bytes)?;
    let mut mesh = Mesh::default();
    for element in &elements {
        // An element of no properties holds nothing, however often its header repeats it.
        if element.properties.is_empty() {
            continue;
        }
        match element.name.as_str() {
            "vertex" => parse_vertices(element, &mut body, &mut mesh)?,
            "face" => parse_faces(element, &mut body, &mut mesh)?,
            _ => {
                for _ in 0..element.count {
                    for property in &element.properties {
                        skip(property, &mut body)?;
                    }
                }
            }
        }
    }
    if mesh.vertices.is_empty() && !elements.iter().any(|e| e.name == "vertex") {
        return Err("it has no vertices".into());
    }
    Ok(mesh)
}

fn parse_header(bytes: &[u8]) -> Result<(Vec<Element>, Body<'_>), String> {
    let mut rest = bytes;
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut first = true;
    loop {
        let end = rest.iter().position(|&b| b == b'\n').ok_or("its header has no end")?;
        let line = std::str::from_utf8(&rest[..end]).map_err(|_| "its header is not text")?;
        rest = &rest[end + 1..];
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        if std::mem::take(&mut first) {
            if words != ["ply"] {
                return Err("it does not start with `ply`".into());
            }
            continue;
        }
        match words.as_slice() {
            ["end_header"] => break,
            [] | ["comment" | "obj_info", ..] => {}
            ["format", name, ..] => format = Some(*name),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| format!("its header counts {count} of {name}"))?;
                elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
            }
            ["property", "list", length, kind, name] => {
                let element = elements.last_mut().ok_or("its header has a property before any element")?;
                let list = Some(Type::from_name(length)?);
                element.properties.push(Property { name: (*name).into(), list, kind: Type::from_name(kind)? });
            }
            ["property", kind, name] => {
                let element = elements.last_mut().ok_or("its header has a property before any element")?;
                element.properties.push(Property { name: (*name).into(), list: None, kind: Type::from_name(kind)? });
            }
            _ => return Err(format!("its header has the line `{line}`")),
        }
    }
    let body = match format {
        Some("ascii") => {
            let text = std::str::from_utf8(rest).map_err(|_| "it says ascii and is not text")?;
            Body::Ascii(text.split_ascii_whitespace())
        }
        Some("binary_little_endian") => Body::Little(rest),
        Some("binary_big_endian") => Body::Big(rest),
        other => return Err(format!("its format is {}", other.unwrap_or("not stated"))),
    };
    Ok((elements, body))
}

fn skip(property: &Property, body: &mut Body<'_>) -> Result<(), String> {
    let n = match property.list {
        Some(length) => list_length(body.next(length)?)?,
        None => 1,
    };
    for _ in 0..n {
        body.next(property.kind)?;
    }
    Ok(())
}

fn list_length(n: f64) -> Result<usize, String> {
    if n >= 0.0 && n.fract() == 0.0 { Ok(n as usize) } else { Err(format!("a list has {n} entries")) }
}

/// What a vertex's property is for: which number of a position, normal or color.
#[derive(Clone, Copy)]
enum Use {
    Position(usize),
    Normal(usize),
    Color(usize),
    None,
}

fn parse_vertices(element: &Element, body: &mut Body<'_>, mesh: &mut Mesh) -> Result<(), String> {
    let uses: Vec<Use> = element
        .properties
        .iter()
        .map(|p| match p.name.as_str() {
            _ if p.list.is_some() => Use::None,
            "x" => Use::Position(0),
            "y" => Use::Position(1),
            "z" => Use::Position(2),
            "nx" => Use::Normal(0),
            "ny" => Use::Normal(1),
            "nz" => Use::Normal(2),
            "red" | "r" | "diffuse_red" => Use::Color(0),
            "green" | "g" | "diffuse_green" => Use::Color(1),
            "blue" | "b" | "diffuse_blue" => Use::Color(2),
            _ => Use::None,
        })
        .collect();
    let count = |f: fn(&Use) -> bool| uses.iter().filter(|u| f(u)).count();
    if count(|u| matches!(u, Use::Position(_))) != 3 {
        return Err("its vertices do not have x, y, z".into());
    }
    let (has_normals, has_colors) =
        (count(|u| matches!(u, Use::Normal(_))) == 3, count(|u| matches!(u, Use::Color(_))) == 3);
    for _ in 0..element.count {
        let (mut position, mut normal, mut color) = ([0.0; 3], [0.0; 3], [0; 3]);
        for (property, &used) in element.properties.iter().zip(&uses) {
            match used {
                Use::None => skip(property, body)?,
                Use::Position(i) => position[i] = body.next(property.kind)? as f32,
                Use::Normal(i) => normal[i] = body.next(property.kind)? as f32,
                Use::Color(i) => {
                    let v = body.next(property.kind)?;
                    let scale = match property.kind {
                        kind if kind.is_float() => 255.0,
                        Type::U16 => 255.0 / 65535.0,
                        _ => 1.0,
                    };
                    color[i] = (v * scale).round().clamp(0.0, 255.0) as u8;
                }
            }
        }
        mesh.vertices.push(position);
        if has_normals {
            mesh.normals.push(normal);
        }
        if has_colors {
            mesh.colors.push(color);
        }
    }
    Ok(())
}

fn parse_faces(element: &Element, body: &mut Body<'_>, mesh: &mut Mesh) -> Result<(), String> {
    let mut corners = Vec::new();
    for _ in 0..element.count {
        for property in &element.properties {
            match property.list {
                Some(length) if matches!(property.name.as_str(), "vertex_indices" | "vertex_index") => {
                    corners.clear();
                    for _ in 0..list_length(body.next(length)?)? {
                        let i = body.next(property.kind)?;
                        if !(i >= 0.0 && i <= f64::from(u32::MAX) && i.fract() == 0.0) {
                            return Err(format!("a face has the vertex {i}"));
                        }
                        corners.push(i as u32);
                    }
                    push_polygon(&mut mesh.faces, &corners);
                }
                _ => skip(property, body)?,
            }
        }
    }
    Ok(())
}
