//! Reading triangle meshes: Wavefront OBJ and PLY (text and little-endian binary). Positions, faces (of any number of corners,
//! cut into fans) and OBJ texture coordinates are read; everything else in the files is skipped.

use std::path::Path;

use super::mesh::{Mesh, Triangle};
use crate::error::SimError;
use crate::maths::{V3, v3};

/// Corners and triangles beyond this are refused.
const MOST: usize = 20_000_000;

/// Reads a mesh, by its file's ending.
pub(crate) fn read(path: &Path, scale: f64) -> Result<Mesh, SimError> {
    let broken = |what: String| SimError::Format {
        path: path.into(),
        what,
        hint: "meshes are Wavefront .obj, or .ply in text or little-endian binary",
    };
    let bytes = std::fs::read(path).map_err(SimError::read(path))?;
    let kind = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let triangles = match kind.as_str() {
        "obj" => parse_obj(&String::from_utf8_lossy(&bytes)),
        "ply" => parse_ply(&bytes),
        other => Err(format!("{other:?} is no kind of mesh that is read")),
    };
    let mut triangles = triangles.map_err(broken)?;
    for t in &mut triangles {
        (t.a, t.b, t.c) = (t.a * scale, t.b * scale, t.c * scale);
    }
    let mesh = Mesh::new(triangles);
    if mesh.len() == 0 {
        return Err(broken("it has no triangle with an area".into()));
    }
    Ok(mesh)
}

/// A corner: position and texture coordinates.
type Corner = (V3, [f64; 2]);

/// Cuts a face into triangles around its first corner.
fn fan(corners: &[Corner], out: &mut Vec<Triangle>) {
    let Some((a, rest)) = corners.split_first() else { return };
    for pair in rest.windows(2) {
        if let [b, c] = pair {
            out.push(Triangle { a: a.0, b: b.0, c: c.0, uv: [a.1, b.1, c.1] });
        }
    }
}

/// The item that an OBJ index means: from 1, or back from the end.
fn indexed<T: Copy>(items: &[T], index: &str) -> Option<T> {
    let i: i64 = index.parse().ok()?;
    let i = if i < 0 { items.len() as i64 + i } else { i - 1 };
    usize::try_from(i).ok().and_then(|i| items.get(i)).copied()
}

pub(crate) fn parse_obj(text: &str) -> Result<Vec<Triangle>, String> {
    let (mut points, mut uvs, mut out) = (Vec::new(), Vec::new(), Vec::new());
    for (number, line) in text.lines().enumerate() {
        let at = |what: String| format!("line {}: {what}", number + 1);
        let mut words = line.split_whitespace();
        let key = words.next().unwrap_or("");
        if key == "v" || key == "vt" {
            let numbers: Vec<f64> = words.map_while(|w| w.parse().ok()).collect();
            match (key, numbers.as_slice()) {
                ("v", [x, y, z, ..]) => points.push(v3(*x, *y, *z)),
                // v counts upwards in OBJ, downwards here.
                ("vt", [u, v, ..]) => uvs.push([*u, 1.0 - *v]),
                _ => return Err(at(format!("{key:?} needs {} numbers", if key == "v" { 3 } else { 2 }))),
            }
        } else if key == "f" {
            let mut corners: Vec<Corner> = Vec::new();
            for word in words {
                let mut parts = word.split('/');
                let p = parts.next().and_then(|i| indexed(&points, i));
                let p =
                    p.ok_or_else(|| at(format!("the face's corner {word:?} is none of {} points", points.len())))?;
                let uv = parts.next().and_then(|i| indexed(&uvs, i)).unwrap_or([0.0; 2]);
                corners.push((p, uv));
            }
            if corners.len() < 3 {
                return Err(at("a face needs three corners".into()));
            }
            fan(&corners, &mut out);
        }
        if points.len() > MOST || out.len() > MOST {
            return Err(at(format!("more than {MOST} points or triangles")));
        }
    }
    Ok(out)
}

/// The number types of PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// A property of an element.
enum Property {
    One(String, Number),
    List(Number, Number),
}

/// Values in the order of the file, from text or bytes.
enum Values<'a> {
    Text(std::str::SplitAsciiWhitespace<'a>),
    Binary(&'a [u8]),
}

impl Values<'_> {
    fn next(&mut self, kind: Number) -> Option<f64> {
        match self {
            Self::Text(words) => words.next().and_then(|w| w.parse().ok()),
            Self::Binary(bytes) => {
                macro_rules! take {
                    ($t:ty) => {{
                        let (head, tail) = bytes.split_first_chunk()?;
                        *bytes = tail;
                        <$t>::from_le_bytes(*head) as f64
                    }};
                }
                Some(match kind {
                    Number::I8 => take!(i8),
                    Number::U8 => take!(u8),
                    Number::I16 => take!(i16),
                    Number::U16 => take!(u16),
                    Number::I32 => take!(i32),
                    Number::U32 => take!(u32),
                    Number::F32 => take!(f32),
                    Number::F64 => take!(f64),
                })
            }
        }
    }
}

pub(crate) fn parse_ply(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    const END: &[u8] = b"end_header";
    let end = bytes.windows(END.len()).position(|w| w == END).ok_or("no end_header: it is no PLY, or cut off")?;
    let header = std::str::from_utf8(bytes.get(..end).unwrap_or(&[])).map_err(|_| "the header is no text")?;
    let mut body = bytes.get(end + END.len()..).unwrap_or(&[]);
    body = body.strip_prefix(b"\r").unwrap_or(body);
    body = body.strip_prefix(b"\n").unwrap_or(body);
    if !header.starts_with("ply") {
        return Err("it does not begin with the word ply".into());
    }
    let mut elements: Vec<(String, usize, Vec<Property>)> = Vec::new();
    let mut binary = None;
    for line in header.lines() {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let number = |name: &str| Number::named(name).ok_or_else(|| format!("unknown number type in {line:?}"));
        match words.as_slice() {
            ["format", "ascii", ..] => binary = Some(false),
            ["format", "binary_little_endian", ..] => binary = Some(true),
            ["format", ..] => return Err(format!("{line:?} is not read; save it as text or little-endian")),
            ["element", name, count] => {
                let count = count
                    .parse()
                    .ok()
                    .filter(|&n: &usize| n <= MOST)
                    .ok_or_else(|| format!("bad count in {line:?}"))?;
                elements.push(((*name).to_owned(), count, Vec::new()));
            }
            ["property", "list", count, item, _] => {
                let property = Property::List(number(count)?, number(item)?);
                elements.last_mut().ok_or("a property before any element")?.2.push(property);
            }
            ["property", kind, name] => {
                let property = Property::One((*name).to_owned(), number(kind)?);
                elements.last_mut().ok_or("a property before any element")?.2.push(property);
            }
            _ => {}
        }
    }
    let mut values = if binary.ok_or("the header names no format")? {
        Values::Binary(body)
    } else {
        Values::Text(std::str::from_utf8(body).map_err(|_| "the body is no text")?.split_ascii_whitespace())
    };
    let (mut points, mut out): (Vec<V3>, Vec<Triangle>) = (Vec::new(), Vec::new());
    let mut corners = Vec::new();
    for (name, count, properties) in &elements {
        if properties.is_empty() {
            continue;
        }
        for i in 0..*count {
            let cut = || format!("{name} {i} of {count}: the file ends, or a number is broken");
            let mut p = V3::ZERO;
            for property in properties {
                match property {
                    Property::One(axis, kind) => {
                        let v = values.next(*kind).ok_or_else(cut)?;
                        match axis.as_str() {
                            "x" => p.x = v,
                            "y" => p.y = v,
                            "z" => p.z = v,
                            _ => {}
                        }
                    }
                    Property::List(length, item) => {
                        let n = values.next(*length).ok_or_else(cut)? as usize;
                        corners.clear();
                        for _ in 0..n {
                            let index = values.next(*item).ok_or_else(cut)?;
                            if name == "face" {
                                let point = points.get(index as usize).filter(|_| index >= 0.0);
                                let point = point
                                    .ok_or_else(|| format!("face {i}: {index} is none of {} points", points.len()))?;
                                corners.push((*point, [0.0; 2]));
                            }
                        }
                        fan(&corners, &mut out);
                    }
                }
            }
            if name == "vertex" {
                points.push(p);
            }
            if out.len() > MOST {
                return Err(format!("more than {MOST} triangles"));
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obj_and_both_plys_give_the_same_square() {
        let obj = "# square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\nf -4 -3 -2\n";
        let from_obj = parse_obj(obj).unwrap();
        assert_eq!(from_obj.len(), 3);
        let head = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            )
        };
        let text = head("ascii") + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
        let mut binary = head("binary_little_endian").into_bytes();
        for v in [0.0_f32, 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.] {
            binary.extend(v.to_le_bytes());
        }
        binary.push(4);
        (0..4_i32).for_each(|i| binary.extend(i.to_le_bytes()));
        for ply in [text.as_bytes(), &binary] {
            let t = parse_ply(ply).unwrap();
            assert_eq!(t.len(), 2);
            assert_eq!((t[1].a, t[1].b, t[1].c), (from_obj[1].a, from_obj[1].b, from_obj[1].c));
        }
    }

    #[test]
    fn broken_meshes_say_where() {
        assert!(parse_obj("v 0 0\n").unwrap_err().contains("line 1"));
        assert!(parse_obj("v 0 0 0\nf 1 2 9\n").unwrap_err().contains("\"2\" is none of 1 points"));
        assert!(
            parse_ply(b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1 2")
                .unwrap_err()
                .contains("vertex 2")
        );
        assert!(parse_ply(b"hello").is_err());
        let bomb = b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n";
        assert!(parse_ply(bomb).unwrap_err().contains("bad count"));
        let list = b"ply\nformat ascii 1.0\nelement face 1\nproperty list uint int v\nend_header\n4294967295 1";
        assert!(parse_ply(list).is_err());
    }
}
