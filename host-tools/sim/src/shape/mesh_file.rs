//! Reading triangle meshes: Wavefront OBJ (through `tobj`) and PLY in text or binary of either order of bytes (through
//! `ply-rs-bw`). Positions, faces (of any number of corners, cut into fans) and OBJ texture coordinates are read; everything
//! else in the files is skipped, material files too. What is here is the way from those crates' lists to triangles, with
//! every index checked.

use std::path::Path;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::mesh::{Mesh, Triangle};
use crate::error::SimError;
use crate::maths::V3;

/// Corners and triangles beyond this are refused.
const MOST: usize = 20_000_000;

/// Reads a mesh, by its file's ending.
pub(crate) fn read(path: &Path, scale: f64) -> Result<Mesh, SimError> {
    let broken =
        |what: String| SimError::Format { path: path.into(), what, hint: "meshes are Wavefront .obj, or .ply" };
    let bytes = std::fs::read(path).map_err(SimError::read(path))?;
    let kind = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let triangles = match kind.as_str() {
        "obj" => parse_obj(&bytes),
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

pub(crate) fn parse_obj(mut bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let options = tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, single_index: false };
    // Colours come from the scene: material files are not opened.
    let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut bytes, &options, no_materials).map_err(|e| e.to_string())?;
    let mut out = Vec::new();
    for tobj::Model { mesh, name } in &models {
        let (points, uvs) = (mesh.positions.as_chunks::<3>().0, mesh.texcoords.as_chunks::<2>().0);
        let point = |i: u32| points.get(i as usize).map(|p| V3::from(*p));
        // v counts upwards in OBJ, downwards here.
        let uv = |k: usize| mesh.texcoord_indices.get(k).and_then(|&i| uvs.get(i as usize)).map(|[u, v]| [*u, 1.0 - v]);
        for (n, [a, b, c]) in mesh.indices.as_chunks::<3>().0.iter().enumerate() {
            let (Some(a), Some(b), Some(c)) = (point(*a), point(*b), point(*c)) else {
                return Err(format!("{name}: triangle {n} names none of {} points", points.len()));
            };
            let uv = [0, 1, 2].map(|k| uv(3 * n + k).unwrap_or([0.0; 2]));
            out.push(Triangle { a, b, c, uv });
            if out.len() > MOST {
                return Err(format!("more than {MOST} triangles"));
            }
        }
    }
    Ok(out)
}

/// What is kept of an element of a PLY file: a vertex's place, or a face's corners.
#[derive(Default)]
struct Record {
    place: V3,
    corners: Vec<f64>,
}

impl PropertyAccess for Record {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let list = matches!(name, "vertex_indices" | "vertex_index");
        let number = match property {
            Property::Char(v) => f64::from(v),
            Property::UChar(v) => f64::from(v),
            Property::Short(v) => f64::from(v),
            Property::UShort(v) => f64::from(v),
            Property::Int(v) => f64::from(v),
            Property::UInt(v) => f64::from(v),
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            _ if !list => return PropertyAccessResult::Ignored,
            Property::ListChar(v) => return self.keep(&v),
            Property::ListUChar(v) => return self.keep(&v),
            Property::ListShort(v) => return self.keep(&v),
            Property::ListUShort(v) => return self.keep(&v),
            Property::ListInt(v) => return self.keep(&v),
            Property::ListUInt(v) => return self.keep(&v),
            Property::ListFloat(_) | Property::ListDouble(_) => return PropertyAccessResult::Ignored,
        };
        match name {
            "x" => self.place.x = number,
            "y" => self.place.y = number,
            "z" => self.place.z = number,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl Record {
    fn keep<T: Copy + Into<f64>>(&mut self, list: &[T]) -> PropertyAccessResult {
        self.corners = list.iter().map(|&v| v.into()).collect();
        PropertyAccessResult::Set
    }
}

pub(crate) fn parse_ply(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let parser = Parser::<Record>::new();
    let mut reader = Reader::new(bytes);
    // The crate's messages show the line over several lines of their own.
    let said = |e: ply_rs_bw::parser::ParseError| e.to_string().replace("\n\t", " ");
    let header = parser.read_header(&mut reader).map_err(said)?;
    let (mut points, mut out) = (Vec::new(), Vec::new());
    for element in header.elements.values() {
        if element.count > MOST {
            return Err(format!("bad count of {}: {}; at most {MOST} are read", element.name, element.count));
        }
        let records = parser.read_payload_for_element(&mut reader, element, &header);
        let records = records.map_err(|e| format!("{}: {}", element.name, said(e)))?;
        match element.name.as_str() {
            "vertex" => points.extend(records.iter().map(|r| r.place)),
            "face" => {
                for (i, face) in records.iter().enumerate() {
                    let point = |&index: &f64| {
                        let point = if index >= 0.0 { points.get(index as usize) } else { None };
                        point.copied().ok_or_else(|| format!("face {i}: {index} is none of {} points", points.len()))
                    };
                    let corners = face.corners.iter().map(point).collect::<Result<Vec<V3>, String>>()?;
                    fan(&corners, &mut out);
                    if out.len() > MOST {
                        return Err(format!("more than {MOST} triangles"));
                    }
                }
            }
            _ => {}
        }
    }
    Ok(out)
}

/// Cuts a face into triangles around its first corner.
fn fan(corners: &[V3], out: &mut Vec<Triangle>) {
    let Some((&a, rest)) = corners.split_first() else { return };
    for &[b, c] in rest.array_windows() {
        out.push(Triangle { a, b, c, uv: [[0.0; 2]; 3] });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obj_and_all_three_plys_give_the_same_square() {
        let obj = "# square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\nf -4 -3 -2\n";
        let from_obj = parse_obj(obj.as_bytes()).unwrap();
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
        let mut big = head("binary_big_endian").into_bytes();
        for v in [0.0_f32, 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.] {
            big.extend(v.to_be_bytes());
        }
        big.push(4);
        (0..4_i32).for_each(|i| big.extend(i.to_be_bytes()));
        for ply in [text.as_bytes(), &binary, &big] {
            let t = parse_ply(ply).unwrap();
            assert_eq!(t.len(), 2);
            assert_eq!((t[1].a, t[1].b, t[1].c), (from_obj[1].a, from_obj[1].b, from_obj[1].c));
        }
    }

    #[test]
    fn broken_meshes_say_what_is_wrong() {
        assert!(parse_obj(b"v 0 0\n").unwrap_err().contains("position"));
        assert!(parse_obj(b"v 0 0 0\nf 1 2 9\n").unwrap_err().contains("out of bounds"));
        assert!(parse_obj(b"v 0 0 0\nf 1 -2 -9\n").is_err());
        let cut = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n2";
        let error = parse_ply(cut).unwrap_err();
        assert!(error.contains("vertex") && !error.contains('\n'), "{error}");
        assert!(parse_ply(b"hello").is_err() && parse_ply(b"").is_err());
        let bomb = b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n";
        assert!(parse_ply(bomb).unwrap_err().contains("bad count"));
        for format in ["ascii", "binary_little_endian"] {
            let list = format!(
                "ply\nformat {format} 1.0\nelement face 1\nproperty list uint int vertex_index\nend_header\n4294967295 1"
            );
            assert!(parse_ply(list.as_bytes()).is_err());
        }
        let astray = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 1\n\
            property list uchar int vertex_indices\nend_header\n1\n3 0 0 -1\n";
        assert!(parse_ply(astray).unwrap_err().contains("-1 is none of 1 points"));
    }
}
