//! Typed rows to figures and pages: SVG, PNG, HTML. Reads no files.
