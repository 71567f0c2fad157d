//! The `gpugi` command.

fn main() -> std::process::ExitCode {
    gpugi_cli::main()
}
