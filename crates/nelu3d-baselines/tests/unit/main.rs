//! All tests of the methods' parts, file by file as they lie in `src`. They are not in the library, which would be
//! compiled twice for them.

mod code;
mod gray {
    mod refine;
    mod table;
}
mod lookup3d;
mod phase;
mod projector {
    mod direct;
    mod fit;
    mod measure_response;
}
mod sinusoids;
mod turbosl {
    mod blur;
    mod projected;
    mod ray;
}
mod wave;
mod zncc;
