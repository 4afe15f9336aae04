use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex, even if a thread panicked while it held the lock.
///
/// Use it for values that a panic does not leave half changed, such as lists that grow. The panic itself is reported
/// where its thread is joined.
pub fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn a_panic_does_not_lose_the_value() {
        let mutex = Mutex::new(3);
        let panicked = thread::scope(|scope| {
            let holding = scope.spawn(|| {
                let _held = locked(&mutex);
                panic!("on purpose");
            });
            holding.join().is_err()
        });
        assert!(panicked && mutex.is_poisoned());
        assert_eq!(*locked(&mutex), 3);
    }
}
