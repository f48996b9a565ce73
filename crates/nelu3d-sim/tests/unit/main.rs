//! All tests of the virtual scanner: of its parts, file by file as they lie in `src`, and of the rigs that it writes
//! (`scanner`). They are not in the library, which would be compiled twice for them.

mod geometry;
mod light {
    mod blur;
    mod grid;
}
mod render {
    mod filter;
    mod rays;
}
mod scanner;
mod scene {
    mod albedo;
    mod board;
    mod deformation;
    mod icosphere;
    mod material;
    mod shape;
    mod triangles;
}
mod sensor;
mod spec {
    mod board;
    mod preset;
}
mod staging;
mod sweep;
