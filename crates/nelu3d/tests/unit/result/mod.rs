mod extra;
mod write;
