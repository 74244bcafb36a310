// A click in the audio library of a Teensy 4 (not tried on a real board).
// Beside it: click.h and click.c of
//   stimlib export click --motion "sinusoid(1.3e-3, 3.0, 1e-3)" --fs 44100 --float32
//     --full-scale 8 --name click --out .
#include <Audio.h>
#include <math.h>

#include "click.h"

static_assert(AUDIO_SAMPLE_RATE_EXACT == CLICK_FS, "export at the sample rate of I2S");
static const float FULL_SCALE = 8.0f;  // N, what 32767 makes on your amplifier and actuator

static click_state state;          // a global: in DTCM
static volatile float position;    // m, from loop()

class Stimulus : public AudioStream {
public:
    Stimulus() : AudioStream(0, nullptr) {}

    // In an interrupt of low priority, once for each block that DMA has sent.
    void update() override
    {
        static float x[AUDIO_BLOCK_SAMPLES], y[AUDIO_BLOCK_SAMPLES], last;
        const float *in[1] = { x };
        float *out[1] = { y };
        audio_block_t *block = allocate();
        if (!block) return;  // AudioMemory() is too small
        const float to = position, step = (to - last) / AUDIO_BLOCK_SAMPLES;
        for (int i = 0; i < AUDIO_BLOCK_SAMPLES; i++) x[i] = last + step * (i + 1);
        last = to;
        click_process(&state, in, out, AUDIO_BLOCK_SAMPLES);
        for (int i = 0; i < AUDIO_BLOCK_SAMPLES; i++) {
            const float v = fminf(fmaxf(y[i] / FULL_SCALE, -1.0f), 1.0f);
            block->data[i] = (int16_t)lrintf(32767.0f * v);
        }
        transmit(block, 0);
        release(block);
    }
};

static Stimulus stimulus;
static AudioOutputI2S i2s;
static AudioConnection left(stimulus, 0, i2s, 0);

void setup()
{
    click_init(&state);
    click_set(&state, CLICK_SINK_GAIN, 1.0f, 0.02f * CLICK_FS);  // opens the fade
    AudioMemory(8);
}

void loop()
{
    position = 4e-3f * (float)analogRead(14) / 1023.0f;  // 4 mm on the whole range
    if (Serial.available() && Serial.read() == 's') {    // stop
        AudioNoInterrupts();  // a parameter is set between two calls
        click_set(&state, CLICK_SINK_GAIN, 0.0f, 0.02f * CLICK_FS);
        AudioInterrupts();
    }
}
