#include "reflexes.h"

#include "numbers.h"

/* Forward speed with a bumper pressed: fast enough for the wheel control, harmless to push with. */
#define CREEP_M_S 0.05f
/* Travel ahead without floor that latches a stop. From 0.2 m/s the reflex needs 2 to 3 cm. */
#define OVER_M 0.05f
/* Number of periods in which a host requests forward speed over a cliff before a stop latches: 1 s.
 * A host that sees the cliff does so for 0.07 s. The time to reverse does not count: from 0.28 m/s
 * the way back takes 1.0 s. */
#define OVER_TICKS 100u
#define SHOWN_TICKS 10u /* one period of the status message */

static void leave(reflexes_t *reflexes)
{
    reflexes->over = false;
    reflexes->ticks = 0;
    reflexes->ahead = 0;
}

static void fade(reflexes_t *reflexes)
{
    if (reflexes->shown != 0) {
        reflexes->shown--;
    }
}

static void follow(reflexes_t *reflexes, const board_encoders_t *counts)
{
    if (reflexes->over) {
        reflexes->ahead += wrapped16((uint16_t)(counts->left - reflexes->counts.left))
            + wrapped16((uint16_t)(counts->right - reflexes->counts.right));
    }
    reflexes->over = true;
    reflexes->counts = *counts;
}

float reflexes_limit(
    reflexes_t *reflexes, float v_m_s, uint8_t contacts, const board_encoders_t *counts)
{
    const bool pressed = contacts & (SP_CONTACT_BUMPER_LEFT | SP_CONTACT_BUMPER_RIGHT);
    float allowed_m_s = v_m_s;
    if (reflexes->at_cliff && (contacts & SP_CONTACT_CLIFF)) {
        if (v_m_s > 0.0f && reflexes->ticks < OVER_TICKS) {
            reflexes->ticks++;
        }
        follow(reflexes, counts);
        allowed_m_s = smaller(v_m_s, 0.0f);
    } else {
        leave(reflexes);
    }
    if (reflexes->at_bumper && pressed) {
        allowed_m_s = smaller(allowed_m_s, CREEP_M_S);
    }
    if (allowed_m_s < v_m_s) {
        reflexes->shown = SHOWN_TICKS;
    } else {
        fade(reflexes);
    }
    return allowed_m_s;
}

void reflexes_rest(reflexes_t *reflexes)
{
    leave(reflexes);
    fade(reflexes);
}

bool reflexes_over(const reflexes_t *reflexes, float metres_per_count)
{
    return reflexes->ticks >= OVER_TICKS
        || 0.5f * (float)reflexes->ahead * metres_per_count >= OVER_M;
}
