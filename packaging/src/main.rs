//! Everything a developer or a release does with the repository: `cargo xtask --help`.

mod addon;
mod apt;
mod chroot;
mod cross;
mod debian;
mod demo;
mod docs;
mod elsewhere;
mod extension;
mod header;
mod install;
mod licences;
mod machine;
mod package;
mod platform;
mod portable;
mod prepare;
mod python;
mod signatures;
mod site;
mod steps;
mod symbols;
mod test;
mod third_party;
mod web;
mod wheel;

use anyhow::Result;
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    about = "Demo, tests, header and packages of Anyface"
)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Tests the installed extension in headless Blender, in any version.
    Addon(addon::Addon),
    /// Makes talking heads from nothing: a .blend, a picture and a film.
    Demo(demo::Demo),
    /// Lists how the numbers and pictures in the documents are made, and which are out of date.
    Docs(docs::Docs),
    /// Builds the Blender extension as a zip.
    Extension(extension::Extension),
    /// Writes the headers in include from the sources of the C interfaces.
    Header(header::Header),
    /// Installs the C library under a prefix, for pkg-config and CMake.
    Install(install::Install),
    /// Writes THIRD-PARTY.md, the licences of the linked crates, with cargo-about.
    Licences(licences::Licences),
    /// Builds everything that is released for one system: zip, wheel, C library, Debian package.
    Package(package::Package),
    /// Installs what the tests need: Python environments, and Blender and Godot as programs.
    Prepare(prepare::Prepare),
    /// Collects everything that is released in a folder for any file host.
    Site(site::Site),
    /// Runs lints and all tests; installs what they need.
    Test(test::Test),
    /// Builds the library as WebAssembly, its npm package, and the page that makes heads talk.
    Web(web::Web),
    /// Builds the Python package as a wheel.
    Wheel(wheel::Wheel),
}

fn main() -> Result<()> {
    match Cli::parse().task {
        Task::Addon(addon) => addon.run(),
        Task::Demo(demo) => demo.run(),
        Task::Docs(docs) => docs.run(),
        Task::Extension(extension) => extension.run(),
        Task::Header(header) => header.run(),
        Task::Install(install) => install.run(),
        Task::Licences(licences) => licences.run(),
        Task::Package(package) => package.run(),
        Task::Prepare(prepare) => prepare.run(),
        Task::Site(site) => site.run(),
        Task::Test(test) => test.run(),
        Task::Web(web) => web.run(),
        Task::Wheel(wheel) => wheel.run(),
    }
}
