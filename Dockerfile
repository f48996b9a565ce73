# The program in a small image: docker build -t nelu3d . && docker run --rm -v "$PWD:/data" nelu3d demo
FROM rust:1.91-slim-bookworm AS build
WORKDIR /src
COPY . .
RUN cargo build --locked --profile dist -p nelu3d-cli --features gige,usb3

FROM gcr.io/distroless/cc-debian12:nonroot
COPY --from=build /src/target/dist/nelu3d /usr/local/bin/nelu3d
COPY LICENSE-APACHE LICENSE-MIT /usr/share/doc/nelu3d/
# Folders of the host are mounted here.
WORKDIR /data
ENTRYPOINT ["nelu3d"]
