mod assemble;
mod mesh;
