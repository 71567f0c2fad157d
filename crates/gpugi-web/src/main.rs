//! `gpugi-web`: packs the viewer's page and serves it on this machine. `./gpugi web` builds and runs it.

#[cfg(not(target_arch = "wasm32"))]
mod pack;
#[cfg(not(target_arch = "wasm32"))]
mod server;

#[cfg(not(target_arch = "wasm32"))]
fn main() -> anyhow::Result<()> {
    use clap::Parser;
    use std::path::PathBuf;

    /// The viewer in a browser: serves its page on this machine and prints the address.
    #[derive(Parser)]
    #[command(name = "gpugi web", version)]
    struct Arguments {
        /// What the page shows first: the name of a built-in scene (`gpugi list scenes`)
        #[arg(default_value = "cornell")]
        scene: String,
        /// Write the page into this folder instead: static files for any web server
        #[arg(long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Port of the address (default: any that is free)
        #[arg(long, default_value_t = 0)]
        port: u16,
        /// What cargo has built
        #[arg(long, value_name = "FILE.wasm", hide = true)]
        module: PathBuf,
    }

    let arguments = Arguments::parse();
    if let Some(folder) = arguments.output {
        pack::pack(&arguments.module, &folder)?;
        println!("{} holds the page", folder.display());
        return Ok(());
    }
    let folder = arguments.module.with_file_name("page");
    pack::pack(&arguments.module, &folder)?;
    let server = server::Server::new(&folder, arguments.port)?;
    println!("{}/#scene={}", server.address, arguments.scene);
    server.run();
    Ok(())
}

#[cfg(target_arch = "wasm32")]
fn main() {}
