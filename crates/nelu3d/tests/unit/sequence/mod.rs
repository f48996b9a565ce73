mod flow;
mod motion;
mod plan;
mod vector_map;
mod white_blend;
