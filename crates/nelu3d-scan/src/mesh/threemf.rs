//! 3MF, for printing: a zip archive of a model in XML (3MF Core Specification 1.3, sections 2 and 4). It states its unit,
//! so that nobody has to guess: millimeters, camera frame.

use std::fmt::Write as _;
use std::io::{self, Cursor, Write};

use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::model::Mesh;

/// The file that says which kinds of files are in the archive.
const CONTENT_TYPES: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
    <Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">\
    <Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>\
    <Default Extension=\"model\" ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/></Types>\n";

/// The file that says which of them is the model.
const RELATIONS: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
    <Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">\
    <Relationship Target=\"/3D/3dmodel.model\" Id=\"rel0\" \
    Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>\n";

/// Name of the model in the archive.
const MODEL: &str = "3D/3dmodel.model";

pub(super) fn write(mesh: &Mesh, w: &mut dyn Write) -> io::Result<()> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in [("[Content_Types].xml", CONTENT_TYPES), ("_rels/.rels", RELATIONS), (MODEL, &model(mesh))] {
        // The format allows deflate and nothing else; without a date the same mesh is the same file.
        archive.start_file(name, SimpleFileOptions::default())?;
        archive.write_all(content.as_bytes())?;
    }
    w.write_all(archive.finish()?.get_ref())
}

/// Returns the model. Vertices without a triangle stay: the format does not mind.
fn model(mesh: &Mesh) -> String {
    let mut xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"millimeter\" xml:lang=\"en-US\" \
                   xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n\
                   <metadata name=\"Application\">nelu3d</metadata>\n\
                   <resources><object id=\"1\" type=\"model\"><mesh>\n<vertices>\n"
        .to_owned();
    // Writing into a text does not fail.
    for [x, y, z] in &mesh.vertices {
        let _ = writeln!(xml, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>");
    }
    xml += "</vertices>\n<triangles>\n";
    for [a, b, c] in &mesh.faces {
        let _ = writeln!(xml, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>");
    }
    xml += "</triangles>\n</mesh></object></resources>\n<build><item objectid=\"1\"/></build>\n</model>\n";
    xml
}
