//! The `cornerbench` command.

fn main() -> std::process::ExitCode {
    cornerbench::cli::main()
}
