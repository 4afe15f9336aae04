# calib for machines that run containers: `docker build -t calib .`, then `docker run --rm -v "$PWD:/work" calib --help`.
FROM rust:1-slim-bookworm AS build
WORKDIR /source
COPY . .
ARG CALIB_COMMIT
RUN CALIB_COMMIT="$CALIB_COMMIT" cargo build --release --locked --bin calib

FROM debian:bookworm-slim
COPY --from=build /source/target/release/calib /usr/local/bin/calib
WORKDIR /work
# No shell in between: signals reach calib, which keeps its state.
ENTRYPOINT ["calib"]
