//! The plain 8253 of the tests: one CLK pulse at a time, flag by flag, from the wording of the data sheet.
//!
//! It shares no code with the model. Registers hold the chip's own bits, BCD is counted digit by digit,
//! and every flag is a flip-flop of the sheet's block diagram. It is slow and must stay so.

use super::CounterId;

#[derive(Clone)]
pub(super) struct Oracle {
    counters: [OracleCounter; 3],
}

impl Oracle {
    pub(super) fn new() -> Self {
        Self { counters: [OracleCounter::new(), OracleCounter::new(), OracleCounter::new()] }
    }

    pub(super) fn counter(&mut self, counter: CounterId) -> &mut OracleCounter {
        &mut self.counters[counter as usize]
    }

    pub(super) fn write_control(&mut self, word: u8) {
        let select = usize::from(word >> 6);
        if select < 3 {
            self.counters[select].write_control(word);
        }
    }

    /// OUT0 is CLK1 and CLK2; a pulse counts at its falling edge.
    pub(super) fn clock_card(&mut self, ticks: u64) -> u64 {
        let mut steps = 0;
        for _ in 0..ticks {
            let before = self.counters[0].out;
            self.counters[0].pulse();
            if before && !self.counters[0].out {
                self.counters[1].pulse();
                self.counters[2].pulse();
                steps += 1;
            }
        }
        steps
    }
}

#[derive(Clone)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "one per flip-flop of the chip; a state machine is what this checks"
)]
pub(super) struct OracleCounter {
    mode: u8,
    bcd: bool,
    /// RL1 RL0: 1 LSB, 2 MSB, 3 both.
    access: u8,
    count_register: u16,
    counting_element: u16,
    output_latch: Option<u16>,
    write_buffer: Option<u8>,
    read_msb: bool,
    gate: bool,
    pub(super) out: bool,
    /// A whole count has come since the control word.
    count_written: bool,
    /// The count register awaits its transfer because of a write.
    null_count: bool,
    /// The gate's edge flip-flop, sampled by the next CLK pulse.
    triggered: bool,
    /// The counting element has been loaded since the control word.
    loaded: bool,
    /// Mode 0, between the two bytes of a count.
    disabled: bool,
    /// Terminal count has been reached since the last load.
    done: bool,
}

impl OracleCounter {
    fn new() -> Self {
        Self {
            mode: 0,
            bcd: false,
            access: 3,
            count_register: 0,
            counting_element: 0,
            output_latch: None,
            write_buffer: None,
            read_msb: false,
            gate: true,
            out: false,
            count_written: false,
            null_count: false,
            triggered: false,
            loaded: false,
            disabled: false,
            done: false,
        }
    }

    fn write_control(&mut self, word: u8) {
        if word & 0x30 == 0 {
            if self.output_latch.is_none() {
                self.output_latch = Some(self.counting_element);
                self.read_msb = false;
            }
            return;
        }
        self.access = word >> 4 & 3;
        self.mode = word >> 1 & 7;
        if self.mode >= 6 {
            self.mode -= 4;
        }
        self.bcd = word & 1 != 0;
        self.output_latch = None;
        self.write_buffer = None;
        self.read_msb = false;
        self.count_written = false;
        self.null_count = false;
        self.triggered = false;
        self.loaded = false;
        self.disabled = false;
        self.done = false;
        self.out = self.mode != 0;
    }

    pub(super) fn write(&mut self, byte: u8) {
        let count = match self.access {
            1 => u16::from(byte),
            2 => u16::from(byte) << 8,
            _ => {
                let Some(low) = self.write_buffer.take() else {
                    self.write_buffer = Some(byte);
                    if self.mode == 0 {
                        self.out = false;
                        self.disabled = true;
                        self.null_count = false;
                    }
                    return;
                };
                u16::from(low) | u16::from(byte) << 8
            }
        };
        self.count_register = if self.bcd { carry_digits(count) } else { count };
        let first = !self.count_written;
        self.count_written = true;
        match self.mode {
            0 => {
                self.out = false;
                self.disabled = false;
                self.null_count = true;
            }
            4 => self.null_count = true,
            2 | 3 if first => self.null_count = true,
            _ => {}
        }
    }

    pub(super) fn read(&mut self) -> u8 {
        let value = self.output_latch.unwrap_or(self.counting_element);
        let (low, high) = ((value & 0xFF) as u8, (value >> 8) as u8);
        match self.access {
            1 => {
                self.output_latch = None;
                low
            }
            2 => {
                self.output_latch = None;
                high
            }
            _ if self.read_msb => {
                self.read_msb = false;
                self.output_latch = None;
                high
            }
            _ => {
                self.read_msb = true;
                low
            }
        }
    }

    pub(super) fn latch_and_read(&mut self) -> u16 {
        self.write_control(0x00);
        match self.access {
            1 => u16::from(self.read()),
            2 => u16::from(self.read()) << 8,
            _ => {
                let low = u16::from(self.read());
                low | u16::from(self.read()) << 8
            }
        }
    }

    pub(super) fn set_gate(&mut self, high: bool) {
        let rising = high && !self.gate;
        self.gate = high;
        if matches!(self.mode, 1 | 2 | 3 | 5) && rising && self.count_written {
            self.triggered = true;
        }
        if matches!(self.mode, 2 | 3) && !high {
            self.out = true;
        }
    }

    /// One CLK pulse.
    pub(super) fn pulse(&mut self) {
        let trigger = std::mem::take(&mut self.triggered);
        let write = std::mem::take(&mut self.null_count);
        match self.mode {
            0 => {
                if write {
                    self.load();
                } else if self.loaded && !self.disabled && self.gate {
                    self.decrement();
                    if self.counting_element == 0 && !self.done {
                        self.done = true;
                        self.out = true;
                    }
                }
            }
            1 => {
                if trigger {
                    self.load();
                    self.out = false;
                } else if self.loaded {
                    self.decrement();
                    if self.counting_element == 0 && !self.done {
                        self.done = true;
                        self.out = true;
                    }
                }
            }
            2 => {
                if trigger || write {
                    self.load();
                } else if self.loaded && self.gate {
                    if self.counting_element == 1 {
                        self.load();
                        self.out = true;
                    } else {
                        self.decrement();
                        if self.counting_element == 1 {
                            self.out = false;
                        }
                    }
                }
            }
            3 => {
                if trigger || write {
                    self.load();
                } else if self.loaded && self.gate {
                    let odd = self.counting_element & 1 != 0;
                    let by = match (odd, self.out) {
                        (false, _) => 2,
                        (true, true) => 1,
                        (true, false) => 3,
                    };
                    for _ in 0..by {
                        self.decrement();
                    }
                    if self.counting_element == 0 {
                        self.load();
                        self.out = !self.out;
                        if self.count_register == 1 {
                            self.out = true;
                        }
                    }
                }
            }
            4 | 5 => {
                self.out = true;
                let (load, enabled) = if self.mode == 4 { (write, self.gate) } else { (trigger, true) };
                if load {
                    self.load();
                } else if self.loaded && enabled {
                    self.decrement();
                    if self.counting_element == 0 && !self.done {
                        self.done = true;
                        self.out = false;
                    }
                }
            }
            _ => unreachable!("three mode bits, with 6 and 7 folded"),
        }
    }

    fn load(&mut self) {
        self.counting_element = self.count_register;
        self.loaded = true;
        self.done = false;
    }

    fn decrement(&mut self) {
        if !self.bcd {
            self.counting_element = self.counting_element.wrapping_sub(1);
            return;
        }
        for place in [0, 4, 8, 12] {
            let digit = self.counting_element >> place & 0xF;
            if digit > 0 {
                self.counting_element -= 1 << place;
                return;
            }
            self.counting_element |= 9 << place;
        }
    }
}

/// Digits above 9 carry into the next; the last carry is lost.
fn carry_digits(bits: u16) -> u16 {
    let mut carried = 0;
    let mut carry = 0;
    for place in [0, 4, 8, 12] {
        let digit = (bits >> place & 0xF) + carry;
        carry = digit / 10;
        carried |= (digit % 10) << place;
    }
    carried
}
