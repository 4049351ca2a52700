//! What a program has begun and waits for later: the handle that it holds, and what the robot does with it. What is begun in
//! a block belongs together; when the block fails, what it has begun is halted.

use std::sync::{Arc, Mutex};

use rhai::{Array, Dynamic, EvalAltResult, Map, Position};
use supersigma_protocol::AxisNumber;

use crate::executive::{Begun, Ended, Failure, Knowledge, Movement, Outcome, Request, Until};

use super::arguments::describe;
use super::lock;
use super::robot::Robot;
use super::trouble::Trouble;

/// What a `begin` block returns.
#[derive(Debug, Clone)]
pub(super) struct Handle(Arc<Mutex<Vec<Part>>>);

/// One movement that was begun.
#[derive(Debug, Clone)]
pub(super) struct Part {
    begun: Begun,
    axes: Vec<AxisNumber>,
    /// Once it is over.
    result: Option<Result<Vec<Movement>, Failure>>,
}

/// A handle that nobody has waited for, and where it was made.
#[derive(Debug)]
pub(super) struct Open {
    handle: Handle,
    position: Position,
}

impl Handle {
    /// Those that are not known to be over.
    fn open(&self) -> Vec<Begun> {
        lock(&self.0).iter().filter(|part| part.result.is_none()).map(|part| part.begun).collect()
    }

    fn is_over(&self) -> bool {
        lock(&self.0).iter().all(|part| part.result.is_some())
    }

    fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    fn has_failed(&self) -> bool {
        lock(&self.0).iter().any(|part| matches!(part.result, Some(Err(_))))
    }

    fn end(&self, ended: &Ended) {
        for part in lock(&self.0).iter_mut().filter(|part| part.begun == ended.begun && part.result.is_none())
        {
            part.result = Some(ended.result.clone());
        }
    }

    /// Nobody will ever tell what became of it.
    fn lose(&self) {
        for part in lock(&self.0).iter_mut().filter(|part| part.result.is_none()) {
            part.result = Some(Err(Failure::Cancelled));
        }
    }
}

impl Robot {
    /// A block begins: its movements are begun and not waited for.
    pub(super) fn open_block(&mut self) {
        self.blocks.push(Vec::new());
    }

    /// The block is over, and this is what it has begun.
    pub(super) fn close_block(&mut self, position: Position) -> Handle {
        let handle = Handle(Arc::new(Mutex::new(self.blocks.pop().unwrap_or_default())));
        self.open.retain(|open| !open.handle.is_over() || open.handle.has_failed());
        self.open.push(Open { handle: handle.clone(), position });
        handle
    }

    /// The block has failed: what it has begun stops, and is forgotten.
    pub(super) fn call_off_block(&mut self) {
        let parts = self.blocks.pop().unwrap_or_default();
        let axes: Vec<_> = parts.iter().flat_map(|part| part.axes.clone()).collect();
        if axes.is_empty() {
            return;
        }
        let begun = parts.iter().map(|part| part.begun).collect();
        // What made the block fail is the news; when the set is gone too, that is told soon enough.
        let _ = self.operate(Request::Halt { axes });
        let _ = self.operate(Request::Await { begun, until: Until::All });
    }

    /// Has a movement carried out, or begun if it stands in a block.
    pub(super) fn make(&mut self, request: Request) -> Result<Vec<Movement>, Trouble> {
        if self.blocks.is_empty() {
            return match self.request(request)? {
                Outcome::Moved(movements) => Ok(movements),
                _ => Err(self.senseless("a movement")),
            };
        }
        let axes = match &request {
            Request::Originate { axes } if axes.is_empty() => {
                self.knowledge.config.axes.iter().map(|axis| axis.address).collect()
            }
            Request::Originate { axes } => axes.clone(),
            Request::SeekReference { axis } => vec![*axis],
            other => other.moving().into_keys().collect(),
        };
        let Outcome::Begun(begun) = self.request(Request::Begin { request: Box::new(request) })? else {
            return Err(self.senseless("the beginning of a movement"));
        };
        if let Some(block) = self.blocks.last_mut() {
            block.push(Part { begun, axes, result: None });
        }
        Ok(vec![])
    }

    /// `together`: what the block has begun is waited for, and halted when one of it fails.
    pub(super) fn together(&mut self, handle: &Handle) -> Result<Dynamic, Trouble> {
        self.settle(std::slice::from_ref(handle), Until::AllOrFailure)?;
        self.see(std::slice::from_ref(handle))
    }

    /// `wait` for one handle.
    pub(super) fn wait_begun(&mut self, handle: &Handle) -> Result<Dynamic, Trouble> {
        self.settle(std::slice::from_ref(handle), Until::All)?;
        self.see(std::slice::from_ref(handle))
    }

    /// `wait_all`.
    pub(super) fn wait_all(&mut self, handles: &Dynamic) -> Result<Dynamic, Trouble> {
        let handles = handles_of(handles)?;
        self.settle(&handles, Until::All)?;
        self.see(&handles)
    }

    /// `wait_any`: the first of them that is over, well or not.
    pub(super) fn wait_any(&mut self, handles: &Dynamic) -> Result<Dynamic, Trouble> {
        let handles = handles_of(handles)?;
        if handles.is_empty() {
            return Err(Trouble::wrong("`wait_any` needs at least one handle"));
        }
        loop {
            if let Some(over) = handles.iter().find(|handle| handle.is_over()) {
                return Ok(Dynamic::from(over.clone()));
            }
            self.settle(&handles, Until::Any)?;
        }
    }

    /// Whether all of it is over, well or not.
    pub(super) fn is_done(&mut self, handle: &Dynamic) -> Result<bool, Trouble> {
        let handle = handle_of(handle)?;
        if !handle.is_over() {
            self.settle(std::slice::from_ref(&handle), Until::Now)?;
        }
        Ok(handle.is_over())
    }

    /// What nobody has waited for is waited for at the program's end. What failed is told with the place of its block.
    pub(super) fn finish(&mut self) -> Result<(), Box<EvalAltResult>> {
        while let Some(Open { handle, position }) = self.open.first() {
            let (handle, position) = (handle.clone(), *position);
            self.wait_begun(&handle).map(drop).map_err(|trouble| {
                let mut error: Box<EvalAltResult> = trouble.into();
                error.set_position(position);
                error
            })?;
        }
        Ok(())
    }

    /// The program has failed: whatever it has begun stops.
    pub(super) fn abandon(&mut self) {
        let begun = self.open.iter().any(|open| !open.handle.is_over()) || !self.blocks.is_empty();
        if begun {
            // If the set does not hear it any more, it halts by itself what this program has begun.
            let _ = self.operate(Request::Abandon);
        }
        self.blocks.clear();
        self.open.drain(..).for_each(|open| open.handle.lose());
    }

    fn settle(&mut self, handles: &[Handle], until: Until) -> Result<(), Trouble> {
        let begun: Vec<Begun> = handles.iter().flat_map(Handle::open).collect();
        if begun.is_empty() {
            return Ok(());
        }
        let Outcome::Ended(ended) = self.request(Request::Await { begun, until })? else {
            return Err(self.senseless("the end of movements"));
        };
        for ended in &ended {
            for handle in handles {
                handle.end(ended);
            }
            for movement in ended.result.iter().flatten() {
                lock(&self.watcher).movement(movement);
            }
        }
        Ok(())
    }

    /// What came of these, which are over; from now on they have been waited for.
    fn see(&mut self, handles: &[Handle]) -> Result<Dynamic, Trouble> {
        self.open.retain(|open| !handles.iter().any(|handle| handle.is(&open.handle)));
        let (mut movements, mut failures) = (Vec::new(), Vec::new());
        for part in handles.iter().flat_map(|handle| lock(&handle.0).clone()) {
            match part.result {
                Some(Ok(moved)) => movements.extend(moved),
                Some(Err(failure)) => failures.push(failure),
                None => {}
            }
        }
        // First what failed by itself, then what was halted for it.
        failures.sort_by_key(|failure| matches!(failure, Failure::Stopped { .. }));
        match failures.len() {
            0 => Ok(results(&movements, &self.knowledge)),
            1 => Err(self.trouble(failures.remove(0))),
            _ => Err(self.trouble(Failure::Several { failures })),
        }
    }
}

/// Movements as a program sees them: an array of maps.
pub(super) fn results(movements: &[Movement], knowledge: &Knowledge) -> Dynamic {
    let maps = movements.iter().map(|movement| {
        let mut map = Map::new();
        map.insert("axis".into(), knowledge.name(movement.axis).into());
        map.insert("kind".into(), movement.kind.to_string().into());
        map.insert("asked".into(), movement.asked.map_or(Dynamic::UNIT, |asked| asked.0.into()));
        map.insert("done".into(), i64::from(movement.done.0).into());
        let position = movement.position.map_or(Dynamic::UNIT, |position| i64::from(position.0).into());
        map.insert("position".into(), position);
        map.insert("start".into(), movement.start.since(supersigma_protocol::Tick(0)).as_seconds().into());
        map.insert("seconds".into(), movement.took.as_seconds().into());
        Dynamic::from(map)
    });
    maps.collect::<Array>().into()
}

/// The handle that a value is.
pub(super) fn handle_of(value: &Dynamic) -> Result<Handle, Trouble> {
    value.clone().try_cast::<Handle>().ok_or_else(|| Trouble::Wrong {
        message: format!("what is waited for is a handle, not {}", describe(value)),
        help: Some("`let handle = begin { move_by(\"left_x\", 400) };` makes one".into()),
    })
}

fn handles_of(value: &Dynamic) -> Result<Vec<Handle>, Trouble> {
    match value.as_array_ref() {
        Ok(array) => array.iter().map(handle_of).collect(),
        Err(_) => Ok(vec![handle_of(value)?]),
    }
}
