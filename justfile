# Recipes of daily work; `just` alone lists them. All but `gate` use the dev profile.

_default:
    @just --list

# Everything that must pass before a merge.
gate tier="full":
    bash .ci/run {{tier}}

# Format, then lint.
lint:
    cargo fmt --all
    cargo clippy --locked --workspace --all-targets -- -D warnings

# How plain the pages are, and where they break a rule of STYLE.md.
style *arguments="--check":
    python3 scripts/style.py {{arguments}}

# Tests of one package: `just test calib-data`, `just test calib-data outliers`.
test package *filter:
    cargo test -p {{package}} {{filter}}

# Tests of the command line whose names contain a text: `just cli sweep`.
cli *filter:
    cargo test -p calib-rl --test cli {{filter}}

# Run calib: `just calib run study.toml`.
calib *arguments:
    cargo run -- {{arguments}}

# Write the JSON Schema of a study anew.
schemas:
    cargo test -p calib-study --test schema write_the_schema -- --ignored

# Write the JSON Schemas of what commands print with --json into a folder.
json-schemas folder:
    cargo run --example json_schemas -- {{folder}}

# Draw the crates in ARCHITECTURE.md anew.
crates:
    cargo test -p calib-rl --test cli draw_the_crates -- --ignored

# Accept what the snapshot tests print now; look at `git diff` afterwards.
bless *filter:
    INSTA_UPDATE=always cargo test -p calib-rl --test cli {{filter}}

# Golden numbers, with the script that makes them: `just golden dtw`. Some need packages: see the script's head.
golden name:
    python3 scripts/golden/{{name}}.py

# The figures of a study's report, anew: `just pictures study.toml`.
pictures study:
    cargo run -- evaluate {{study}} --force
