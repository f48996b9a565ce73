mod code;
mod judgment;
