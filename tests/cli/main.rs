//! `volcomp` from the outside: commands, files, messages, limits of what is read.

mod assemble_cli;
mod bench_cli;
mod config_files;
mod config_messages;
mod conventions;
mod correct_cli;
mod diff_cli;
mod evaluate_cli;
mod fit_cli;
mod identify_cases;
mod identify_into;
mod identify_tables;
mod import_export;
mod input_limits;
mod machine_messages;
mod measurement_checks;
mod model_extend;
mod model_show;
mod outputs;
mod predict_cli;
mod reports;
mod schema;
mod streams_and_ranges;
mod targets;
