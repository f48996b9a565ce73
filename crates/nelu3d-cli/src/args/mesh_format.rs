//! The formats of results, besides those that every result has.

use nelu3d::result::ExtraFiles;

/// A format that the surface is written in besides mesh.ply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum MeshFormat {
    /// Wavefront, text.
    Obj,
    /// Stereolithography, binary.
    Stl,
    /// glTF, binary.
    Glb,
    /// 3D Manufacturing Format, for printing.
    #[value(name = "3mf")]
    ThreeMf,
    /// Wavefront with the flash as its picture.
    TexturedObj,
    /// glTF with the flash as its picture.
    TexturedGlb,
}

impl MeshFormat {
    /// Returns the place of its file among the files to write.
    pub(crate) fn file_in(self, extra: &mut ExtraFiles) -> &mut bool {
        match self {
            Self::Obj => &mut extra.obj,
            Self::Stl => &mut extra.stl,
            Self::Glb => &mut extra.glb,
            Self::ThreeMf => &mut extra.threemf,
            Self::TexturedObj => &mut extra.textured_obj,
            Self::TexturedGlb => &mut extra.textured_glb,
        }
    }
}

/// A format that points or depth are written in besides points.ply and depth.npy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum OtherFormat {
    /// Point Cloud Library: one point a pixel, with 1σ.
    Pcd,
    /// E57: points in meters, with 1σ.
    E57,
    /// Depth as TIFF of 32-bit floats.
    Tiff,
    /// Depth as OpenEXR of 32-bit floats.
    Exr,
}

impl OtherFormat {
    /// Returns the place of its file among the files to write.
    pub(crate) fn file_in(self, extra: &mut ExtraFiles) -> &mut bool {
        match self {
            Self::Pcd => &mut extra.pcd,
            Self::E57 => &mut extra.e57,
            Self::Tiff => &mut extra.tiff,
            Self::Exr => &mut extra.exr,
        }
    }
}
