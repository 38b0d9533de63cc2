//! One worker: a process that is asked by lines and must answer each within a deadline.
//!
//! A worker may die, hang, or talk rubbish. Each is an error that says what it was and what to do; after it the process is ended
//! and asked no more. Only a refusal leaves it alive: then one method is missing, not the library.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use super::protocol::{Answer, Request};

/// Longer than any list of methods.
const LONGEST_LINE: u64 = 64 * 1024;

/// What went wrong with one worker.
#[derive(Debug, thiserror::Error)]
pub(super) enum WorkerError {
    #[error("{name}: can't start {program} ({error}); run `cargo xtask peers` again")]
    Start { name: String, program: String, error: std::io::Error },
    #[error(
        "{name}: the worker ended while asked `{asked}`{last}; if `cargo xtask peers` does not mend it, the library crashed on this frame"
    )]
    Died { name: String, asked: String, last: String },
    #[error("{name}: no answer to `{asked}` in {} s; it was ended. Try a smaller --size", .after.as_secs_f64())]
    Silent { name: String, asked: String, after: Duration },
    #[error(
        "{name}: `{said}` is no answer to `{asked}`; worker and bench differ in age: run `cargo xtask peers` again"
    )]
    Rubbish { name: String, asked: String, said: String },
    #[error("{name}: refused `{asked}`: {why}")]
    Refused { name: String, asked: String, why: String },
    #[error("{name}: has ended before")]
    Gone { name: String },
}

impl WorkerError {
    /// Whether the process can be asked again.
    pub(super) const fn lives_on(&self) -> bool {
        matches!(self, Self::Refused { .. })
    }
}

/// The process, as long as it behaves.
#[derive(Debug)]
pub(super) struct Worker {
    pub(super) name: String,
    running: Option<Running>,
    patience: Duration,
    errors: PathBuf,
}

#[derive(Debug)]
struct Running {
    child: Child,
    requests: ChildStdin,
    answers: Receiver<String>,
}

impl Worker {
    /// Starts it. What it says on standard error goes to a file in `folder`; every answer must come within `patience`.
    pub(super) fn start(
        name: &str,
        command: &[String],
        folder: &Path,
        patience: Duration,
    ) -> Result<Self, WorkerError> {
        let (program, arguments) = command.split_first().map_or(("", &[][..]), |(p, a)| (p.as_str(), a));
        let errors = folder.join(format!("{name}.stderr"));
        let failed = |error| WorkerError::Start { name: name.to_owned(), program: program.to_owned(), error };
        let stderr = File::create(&errors).map_err(failed)?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(stderr);
        let mut child = command.spawn().map_err(failed)?;
        let (Some(requests), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            unreachable!("both were asked for")
        };
        // Bounded: a worker that never stops talking blocks itself, not our memory.
        let (send, answers) = sync_channel(4);
        std::thread::spawn(move || {
            let mut output = BufReader::new(output);
            loop {
                let mut line = Vec::new();
                let read = (&mut output).take(LONGEST_LINE).read_until(b'\n', &mut line);
                if !matches!(read, Ok(1..)) || send.send(String::from_utf8_lossy(&line).into_owned()).is_err() {
                    return;
                }
            }
        });
        Ok(Self { name: name.to_owned(), running: Some(Running { child, requests, answers }), patience, errors })
    }

    /// Asks, and waits for the answer. Whoever is not merely refused has ended the worker.
    pub(super) fn ask(&mut self, request: &Request<'_>) -> Result<Answer, WorkerError> {
        let answer = self.exchange(request);
        if answer.as_ref().is_err_and(|e| !e.lives_on()) {
            self.end();
        }
        answer
    }

    /// As [`ask`](Self::ask), for an answer of one form; another form is rubbish.
    pub(super) fn ask_for<T>(
        &mut self,
        request: &Request<'_>,
        form: impl FnOnce(Answer) -> Option<T>,
    ) -> Result<T, WorkerError> {
        let answer = self.ask(request)?;
        let said = format!("{answer:?}");
        form(answer).ok_or_else(|| {
            self.end();
            self.rubbish(request, &said)
        })
    }

    fn exchange(&mut self, request: &Request<'_>) -> Result<Answer, WorkerError> {
        let Some(running) = &mut self.running else { return Err(WorkerError::Gone { name: self.name.clone() }) };
        // What was said before being asked would be taken for this answer, and so on for ever.
        if let Ok(early) = running.answers.try_recv() {
            return Err(self.rubbish(request, &early));
        }
        if writeln!(running.requests, "{request}").and_then(|()| running.requests.flush()).is_err() {
            return Err(self.died(request));
        }
        match running.answers.recv_timeout(self.patience) {
            Ok(line) => match Answer::parse(&line) {
                Some(Answer::Refused { error }) => {
                    Err(WorkerError::Refused { name: self.name.clone(), asked: short(request), why: tidy(&error) })
                }
                Some(answer) => Ok(answer),
                None => Err(self.rubbish(request, &line)),
            },
            Err(RecvTimeoutError::Timeout) => {
                Err(WorkerError::Silent { name: self.name.clone(), asked: short(request), after: self.patience })
            }
            Err(RecvTimeoutError::Disconnected) => Err(self.died(request)),
        }
    }

    fn rubbish(&self, request: &Request<'_>, said: &str) -> WorkerError {
        WorkerError::Rubbish { name: self.name.clone(), asked: short(request), said: tidy(said) }
    }

    fn died(&self, request: &Request<'_>) -> WorkerError {
        let text = std::fs::read(&self.errors).unwrap_or_default();
        let text = String::from_utf8_lossy(&text);
        let last = text.lines().rev().find(|l| !l.trim().is_empty());
        let last = last.map_or_else(String::new, |l| format!(" (its last words: {})", tidy(l)));
        WorkerError::Died { name: self.name.clone(), asked: short(request), last }
    }

    /// Ends the process.
    fn end(&mut self) {
        if let Some(mut running) = self.running.take() {
            // It may be gone already.
            let _ = running.child.kill();
            let _ = running.child.wait();
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.end();
    }
}

/// The request's first two words: enough to know it by.
fn short(request: &Request<'_>) -> String {
    request.to_string().split(' ').take(2).collect::<Vec<_>>().join(" ")
}

/// One line that a terminal survives.
fn tidy(text: &str) -> String {
    text.trim().chars().map(|c| if c.is_control() { ' ' } else { c }).take(160).collect()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::peers::tests::{Scratch, script};

    const HELLO: Request<'_> = Request::Hello;

    fn asked(body: &str, times: usize) -> Vec<Result<Answer, WorkerError>> {
        let scratch = Scratch::new();
        let mut worker = Worker::start("fake", &script(body), &scratch.0, Duration::from_millis(1500)).unwrap();
        (0..times).map(|_| worker.ask(&HELLO)).collect()
    }

    #[test]
    fn an_answer_is_an_answer() {
        let body = r#"while read -r l; do echo '{"peer": "Fake", "version": "1"}'; done"#;
        for answer in asked(body, 3) {
            assert_eq!(answer.unwrap(), Answer::Peer { peer: "Fake".into(), version: "1".into() });
        }
    }

    #[test]
    fn a_refusal_ends_nothing() {
        let answers = asked(r#"while read -r l; do echo '{"error": "not today"}'; done"#, 2);
        assert!(answers.iter().all(|a| matches!(a, Err(WorkerError::Refused { why, .. }) if why == "not today")));
    }

    #[test]
    fn death_is_told_with_the_last_words_and_then_it_is_gone() {
        let answers = asked("read -r l; echo 'no module named cv2' >&2; exit 3", 2);
        let text = answers[0].as_ref().unwrap_err().to_string();
        assert!(text.contains("no module named cv2") && text.contains("cargo xtask peers"), "{text}");
        assert!(matches!(answers[1], Err(WorkerError::Gone { .. })));
    }

    #[test]
    fn rubbish_ends_it() {
        for body in ["read -r l; echo 'Segmentation fault'; sleep 9", "echo early; sleep 9", "yes"] {
            let answers = asked(body, 2);
            let text = answers[0].as_ref().unwrap_err().to_string();
            assert!(text.contains("no answer to `hello`") && text.contains("cargo xtask peers"), "{body}: {text}");
            assert!(matches!(answers[1], Err(WorkerError::Gone { .. })), "{body}");
        }
    }

    #[test]
    fn who_hangs_is_ended() {
        let answers = asked("sleep 60", 2);
        let text = answers[0].as_ref().unwrap_err().to_string();
        assert!(text.contains("1.5 s") && text.contains("--size"), "{text}");
        assert!(matches!(answers[1], Err(WorkerError::Gone { .. })));
    }

    #[test]
    fn another_form_is_rubbish() {
        let scratch = Scratch::new();
        let body = r#"while read -r l; do echo '{"written": 3}'; done"#;
        let mut worker = Worker::start("fake", &script(body), &scratch.0, Duration::from_secs(5)).unwrap();
        let answer = worker.ask_for(&HELLO, |a| matches!(a, Answer::Peer { .. }).then_some(()));
        assert!(matches!(answer, Err(WorkerError::Rubbish { .. })), "{answer:?}");
    }

    #[test]
    fn what_is_not_there_is_not_started() {
        let scratch = Scratch::new();
        let error =
            Worker::start("fake", &["/no/such".to_owned()], &scratch.0, Duration::ZERO).unwrap_err().to_string();
        assert!(error.contains("/no/such") && error.contains("cargo xtask peers"), "{error}");
    }
}
