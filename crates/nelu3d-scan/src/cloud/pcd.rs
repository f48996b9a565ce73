//! PCD, the format of the Point Cloud Library and Open3D
//! (pointclouds.org/documentation/tutorials/pcd_file_format.html).

use std::io::{self, Write};

use super::organized::OrganizedCloud;

pub(super) fn write(cloud: &OrganizedCloud, w: &mut dyn Write) -> io::Result<()> {
    let (width, height) = (cloud.width, cloud.height);
    // The library's own names; `rgb` is three bytes in the place of a float.
    writeln!(
        w,
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z rgb sigma\n\
         SIZE 4 4 4 4 4 4 4 4\nTYPE F F F F F F U F\nCOUNT 1 1 1 1 1 1 1 1\nWIDTH {width}\nHEIGHT {height}\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary",
        width * height
    )?;
    for i in 0..width * height {
        for value in cloud.positions[i].iter().chain(&cloud.normals[i]) {
            w.write_all(&value.to_le_bytes())?;
        }
        let [r, g, b] = cloud.colors[i];
        w.write_all(&[b, g, r, 0])?;
        w.write_all(&cloud.sigma[i].to_le_bytes())?;
    }
    Ok(())
}
