//! Rebuilds when a file of the browser client comes or goes, because it is embedded at compile time.

fn main() {
    for path in ["index.html", "docs.html", "src", "styles"] {
        println!("cargo:rerun-if-changed=../../web-client/{path}");
    }
}
