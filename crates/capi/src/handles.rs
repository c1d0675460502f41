//! Handle of an object for C: a number, never an address, so that a wrong one is refused and never followed.

use crate::errors::{BAD_HANDLE, BROKEN, CallError};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// The last number given to anything.
static LAST: AtomicUsize = AtomicUsize::new(0);

/// All objects of a kind that C holds.
pub(crate) struct Handles<T> {
    kind: &'static str,
    live: RwLock<BTreeMap<usize, Arc<Mutex<T>>>>,
}

impl<T> Handles<T> {
    pub(crate) const fn new(kind: &'static str) -> Self {
        Self { kind, live: RwLock::new(BTreeMap::new()) }
    }

    /// Keeps an object; gives its number, which nothing had before and nothing will have.
    pub(crate) fn add(&self, object: T) -> Result<usize, CallError> {
        let next = |last: usize| last.checked_add(1);
        let last = LAST.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next);
        let number = last.map_err(|_| CallError::new(BROKEN, "there are no numbers left for handles: start anew"))? + 1;
        let object = Arc::new(Mutex::new(object));
        self.live.write().unwrap_or_else(PoisonError::into_inner).insert(number, object);
        Ok(number)
    }

    /// Works with an object; a second thread waits.
    pub(crate) fn with<A>(
        &self,
        number: usize,
        work: impl FnOnce(&mut T) -> Result<A, CallError>,
    ) -> Result<A, CallError> {
        let live = self.live.read().unwrap_or_else(PoisonError::into_inner).get(&number).cloned();
        let object = live.ok_or_else(|| self.unknown(number))?;
        let mut object = object.lock().map_err(|_| {
            CallError::new(BROKEN, format!("a fault ended in this {} before: free it, and make a new one", self.kind))
        })?;
        work(&mut object)
    }

    /// Forgets an object; what another thread does with it comes to its end.
    pub(crate) fn remove(&self, number: usize) -> Result<(), CallError> {
        let found = self.live.write().unwrap_or_else(PoisonError::into_inner).remove(&number);
        found.map(drop).ok_or_else(|| self.unknown(number))
    }

    fn unknown(&self, number: usize) -> CallError {
        let what = if number == 0 { "is NULL" } else { "was never given, is of another kind, or was freed" };
        CallError::new(BAD_HANDLE, format!("{}: the handle {what}", self.kind))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::guarded;

    #[test]
    fn a_number_is_used_once_and_by_its_own_kind() {
        let (some, others) = (Handles::new("detector"), Handles::new("graph"));
        let one = some.add(5).unwrap();
        assert_eq!(some.with(one, |x| Ok(*x)).unwrap(), 5);
        assert_eq!(others.with(one, |x: &mut i32| Ok(*x)).unwrap_err().code, BAD_HANDLE);
        some.remove(one).unwrap();
        assert_eq!(some.with(one, |x| Ok(*x)).unwrap_err().code, BAD_HANDLE);
        assert_eq!(some.remove(one).unwrap_err().code, BAD_HANDLE);
        assert_ne!(some.add(5).unwrap(), one);
    }

    #[test]
    fn what_a_fault_ended_in_is_not_used_again_and_can_be_freed() {
        let some = Handles::new("detector");
        let one = some.add(5).unwrap();
        let fault = || guarded(|| some.with(one, |_| panic!("on purpose")));
        assert_eq!([fault(), fault()], [BROKEN, BROKEN]);
        some.remove(one).unwrap();
    }
}
