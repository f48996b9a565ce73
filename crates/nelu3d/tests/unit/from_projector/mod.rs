mod inputs;
mod response;
