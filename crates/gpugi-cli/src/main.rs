//! The `gpugi` command.

fn main() -> std::process::ExitCode {
    gpugi_cli::run(std::env::args_os()).into()
}
