/* SPDX-License-Identifier: Apache-2.0 */
/* Each function reduces its argument to a small remainder by a table, and evaluates a polynomial of
   the remainder. Entries and constants are pairs: the nearest double, and the remaining error. */
#include "anhyst/numeric/elementary.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "anhyst/numeric/arctangent.h"

typedef anhyst_pair pair;

static uint64_t double_to_bits(double value)
{
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}

static double bits_to_double(uint64_t bits)
{
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* Table of 2^(i/64) as pairs of numbers. The second number of a pair is relative to the first. */
static const pair power_table[64] = {
    {0x1.0000000000000p+0, 0.0},         {0x1.02c9a3e778061p+0, -1.5071e-17},
    {0x1.059b0d3158574p+0, 4.9997e-17},  {0x1.0874518759bc8p+0, 7.3578e-18},
    {0x1.0b5586cf9890fp+0, 8.1893e-17},  {0x1.0e3ec32d3d1a2p+0, 1.6666e-18},
    {0x1.11301d0125b51p+0, -7.4028e-17}, {0x1.1429aaea92de0p+0, -6.1707e-17},
    {0x1.172b83c7d517bp+0, -2.7939e-17}, {0x1.1a35beb6fcb75p+0, 4.7770e-17},
    {0x1.1d4873168b9aap+0, 9.3417e-17},  {0x1.2063b88628cd6p+0, 4.5857e-17},
    {0x1.2387a6e756238p+0, 7.8266e-17},  {0x1.26b4565e27cddp+0, 2.8238e-17},
    {0x1.29e9df51fdee1p+0, 3.2905e-17},  {0x1.2d285a6e4030bp+0, 4.7214e-17},
    {0x1.306fe0a31b715p+0, 3.3485e-17},  {0x1.33c08b26416ffp+0, 5.5276e-17},
    {0x1.371a7373aa9cbp+0, -6.3466e-17}, {0x1.3a7db34e59ff7p+0, -1.5456e-17},
    {0x1.3dea64c123422p+0, 3.7509e-17},  {0x1.4160a21f72e2ap+0, -5.3461e-18},
    {0x1.44e086061892dp+0, 2.1023e-18},  {0x1.486a2b5c13cd0p+0, 1.3358e-17},
    {0x1.4bfdad5362a27p+0, 1.9573e-17},  {0x1.4f9b2769d2ca7p+0, -5.4781e-17},
    {0x1.5342b569d4f82p+0, -2.1571e-17}, {0x1.56f4736b527dap+0, 6.6638e-17},
    {0x1.5ab07dd485429p+0, 5.6865e-17},  {0x1.5e76f15ad2148p+0, 7.0079e-17},
    {0x1.6247eb03a5585p+0, -4.8923e-17}, {0x1.6623882552225p+0, -6.8723e-17},
    {0x1.6a09e667f3bcdp+0, -6.8358e-17}, {0x1.6dfb23c651a2fp+0, -8.4160e-18},
    {0x1.71f75e8ec5f74p+0, -2.0923e-17}, {0x1.75feb564267c9p+0, -3.8335e-17},
    {0x1.7a11473eb0187p+0, -2.3591e-17}, {0x1.7e2f336cf4e62p+0, 9.5069e-18},
    {0x1.82589994cce13p+0, -6.7352e-17}, {0x1.868d99b4492edp+0, -7.2266e-17},
    {0x1.8ace5422aa0dbp+0, 5.1548e-17},  {0x1.8f1ae99157736p+0, 2.4254e-17},
    {0x1.93737b0cdc5e5p+0, -6.4321e-18}, {0x1.97d829fde4e50p+0, -6.3362e-17},
    {0x1.9c49182a3f090p+0, 1.5341e-17},  {0x1.a0c667b5de565p+0, -4.1234e-17},
    {0x1.a5503b23e255dp+0, -6.1526e-17}, {0x1.a9e6b5579fdbfp+0, 3.5409e-17},
    {0x1.ae89f995ad3adp+0, 4.8752e-17},  {0x1.b33a2b84f15fbp+0, -4.7195e-18},
    {0x1.b7f76f2fb5e47p+0, -1.0772e-17}, {0x1.bcc1e904bc1d2p+0, 1.8214e-17},
    {0x1.c199bdd85529cp+0, 1.6855e-17},  {0x1.c67f12e57d14bp+0, 3.6216e-17},
    {0x1.cb720dcef9069p+0, 1.0156e-17},  {0x1.d072d4a07897cp+0, -5.4951e-17},
    {0x1.d5818dcfba487p+0, 1.7901e-17},  {0x1.da9e603db3285p+0, 5.2654e-17},
    {0x1.dfc97337b9b5fp+0, -3.2669e-17}, {0x1.e502ee78b3ff6p+0, 1.7964e-17},
    {0x1.ea4afa2a490dap+0, -5.5451e-17}, {0x1.efa1bee615a27p+0, 5.3368e-17},
    {0x1.f50765b6e4540p+0, 4.5785e-17},  {0x1.fa7c1819e90d8p+0, 2.0414e-17}};

/* Returns exp(x) * 2^-shift. Adding the magic number rounds x*64/ln 2 to an integer in the low
   bits. Six bits of this integer are the index in the table, and the others become the exponent. */
static double scaled_exp(double x, uint64_t shift)
{
  const double magic = 0x1.8p52;
  const double shifted = x * 0x1.71547652b82fep+6 + magic;
  const double steps = shifted - magic;
  const uint64_t bits = double_to_bits(shifted);
  const pair *at = &power_table[bits & 63U];
  const double r = (x - steps * 0x1.62e42fefc0000p-7) + steps * 0x1.c610ca86c3899p-43;
  const double r2 = r * r;
  /* Fifth order. A Chebyshev polynomial distributes the sixth-order term over the other terms. */
  const double low = 0.49999999999932843 + r * (1.0 / 6.0);
  const double high = 0.041666727751466 + r * (1.0 / 120.0);
  const double scale = bits_to_double(double_to_bits(at->value) + (((bits >> 6U) - shift) << 52U));
  return scale + scale * ((r + at->residual) + (r2 * low + (r2 * r2) * high));
}

double anhyst_exp_f64(double x)
{
  /* At large |x|, the final product is infinite, subnormal or normal. */
  const uint64_t scale_shift = 128U;
  if (x < 700.0 && x > -700.0) {
    return scaled_exp(x, 0U);
  }
  if (x > 0.0) {
    return x < 710.0 ? scaled_exp(x, scale_shift) * 0x1p128 : HUGE_VAL;
  }
  if (x < 0.0) {
    return x > -746.0 ? scaled_exp(x, 0U - scale_shift) * 0x1p-128 : 0.0;
  }
  return x; /* NaN */
}

/* Table of log(c) as pairs, for c = 1 + i/64; from i = 26 on, of log(c/2). The first number is
   rounded to a grid that also contains integer multiples of log 2. Both entries next to 1 are
   exact, so that no digits cancel there. */
static const pair log_table[65] = {{0.0, 0.0},
                                   {0x1.fc0a8b0fc0000p-7, 1.727456750e-15},
                                   {0x1.f829b0e780000p-6, 4.529814258e-14},
                                   {0x1.77458f6330000p-5, -6.219834199e-14},
                                   {0x1.f0a30c0118000p-5, -5.213620639e-14},
                                   {0x1.341d7961bc000p-4, 6.329065959e-14},
                                   {0x1.6f0d28ae58000p-4, -7.355770219e-14},
                                   {0x1.a926d3a4ac000p-4, 7.598636597e-14},
                                   {0x1.e27076e2b0000p-4, -4.654729748e-14},
                                   {0x1.0d77e7cd08000p-3, 1.019573522e-13},
                                   {0x1.29552f8200000p-3, -7.718001337e-14},
                                   {0x1.44d2b6ccb8000p-3, -2.047235780e-14},
                                   {0x1.5ff3070a7a000p-3, -8.649239607e-14},
                                   {0x1.7ab890210e000p-3, -4.948516766e-14},
                                   {0x1.9525a9cf46000p-3, -6.604544877e-14},
                                   {0x1.af3c94e80c000p-3, -3.650718883e-16},
                                   {0x1.c8ff7c79aa000p-3, -4.169796585e-14},
                                   {0x1.e27076e2b0000p-3, -9.309459495e-14},
                                   {0x1.fb9186d5e4000p-3, -1.302979717e-14},
                                   {0x1.0a324e2739000p-2, 1.262172940e-14},
                                   {0x1.1675cababa000p-2, 8.604306773e-14},
                                   {0x1.22941fbcf8000p-2, -9.383417224e-14},
                                   {0x1.2e8e2bae12000p-2, -3.993416384e-14},
                                   {0x1.3a64c55694000p-2, 8.403156305e-14},
                                   {0x1.4618bc21c6000p-2, -1.762543131e-14},
                                   {0x1.51aad872e0000p-2, -1.111867139e-13},
                                   {-0x1.68ac83e9c7000p-2, 8.414918193e-14},
                                   {-0x1.5d5bddf596000p-2, 1.156568625e-14},
                                   {-0x1.522ae0738a000p-2, -5.461214449e-14},
                                   {-0x1.4718dc271c000p-2, -5.834357420e-14},
                                   {-0x1.3c25277333000p-2, -2.152212749e-14},
                                   {-0x1.314f1e1d36000p-2, 4.420408334e-14},
                                   {-0x1.269621134e000p-2, 6.292357389e-14},
                                   {-0x1.1bf99635a7000p-2, 6.279055733e-14},
                                   {-0x1.1178e8227e000p-2, -6.371947270e-14},
                                   {-0x1.07138604d6000p-2, 1.082217165e-13},
                                   {-0x1.f991c6cb3c000p-3, 8.899851357e-14},
                                   {-0x1.e530effe72000p-3, 1.131852691e-13},
                                   {-0x1.d1037f2656000p-3, 1.078736750e-14},
                                   {-0x1.bd087383be000p-3, 5.204008743e-14},
                                   {-0x1.a93ed3c8ae000p-3, 4.342542260e-14},
                                   {-0x1.95a5adcf70000p-3, -1.063412830e-14},
                                   {-0x1.823c16551a000p-3, -2.669343158e-14},
                                   {-0x1.6f0128b756000p-3, -7.626153677e-14},
                                   {-0x1.5bf406b544000p-3, 1.637627641e-14},
                                   {-0x1.4913d8333c000p-3, 7.547106028e-14},
                                   {-0x1.365fcb015a000p-3, 1.130710481e-13},
                                   {-0x1.23d712a49c000p-3, -1.425643948e-14},
                                   {-0x1.1178e8227e000p-3, -3.185973635e-14},
                                   {-0x1.fe89139dbc000p-4, -7.601671270e-14},
                                   {-0x1.da72763844000p-4, -2.356882218e-14},
                                   {-0x1.b6ac88dad4000p-4, -9.631011034e-14},
                                   {-0x1.9335e5d594000p-4, -3.387124103e-14},
                                   {-0x1.700d30aeac000p-4, -3.121874881e-15},
                                   {-0x1.4d3115d208000p-4, 4.713370778e-15},
                                   {-0x1.2aa04a4470000p-4, -8.399594274e-14},
                                   {-0x1.08598b59e4000p-4, 2.122560804e-14},
                                   {-0x1.ccb73cddd8000p-5, -9.023009281e-14},
                                   {-0x1.894aa149f8000p-5, -9.106054379e-14},
                                   {-0x1.466aed42e0000p-5, 4.989377672e-14},
                                   {-0x1.0415d89e78000p-5, 1.061065274e-13},
                                   {-0x1.8492528c90000p-6, 4.730054772e-14},
                                   {-0x1.0205658930000p-6, -7.840703383e-14},
                                   {-0x1.0101575880000p-7, -9.878410481e-14},
                                   {0.0, 0.0}};

double anhyst_log_f64(double x)
{
  uint64_t bits = double_to_bits(x);
  double exponent = -1023.0;
  if (!(x > 0.0)) {
    return x < 0.0 ? (double)NAN : isnan(x) ? x : -HUGE_VAL;
  }
  if (x > 0x1.fffffffffffffp+1023) {
    return x;
  }
  if (x < 0x1p-1022) {
    bits = double_to_bits(x * 0x1p54);
    exponent -= 54.0;
  }
  /* x = m * 2^exponent, and c close to m: log(x) = log(c) + log(1 + r) + exponent*log 2 */
  const uint64_t one = UINT64_C(1023) << 52U;
  const uint64_t digits = bits & 0x000FFFFFFFFFFFFFU;
  const uint64_t i = (digits + (UINT64_C(1) << 45U)) >> 46U;
  const double m = bits_to_double(digits | one);
  const double c = bits_to_double(one + (i << 46U));
  const double r = (m - c) / c;
  const pair *at = &log_table[i];
  exponent += (double)(int)((bits >> 52U) + (i >= 26U ? 1U : 0U));
  const double r2 = r * r;
  const double low = (0.5 - r * (1.0 / 3.0)) + r2 * (0.25 - r * 0.2);
  const double high = (1.0 / 6.0 - r * (1.0 / 7.0)) + r2 * 0.125;
  const double series = r2 * low + (r2 * r2) * (r2 * high);
  const double coarse_sum = exponent * 0x1.62e42fefa3800p-1 + at->value; /* exact */
  const double sum = coarse_sum + r;
  const double rest = ((coarse_sum - sum) + r) + (at->residual + exponent * 0x1.ef35793c76730p-45);
  return sum + (rest - series);
}

/* Table of atan(c) as pairs: c = 0, then the centre of each eighth of an octave from 1/32 to 64. */
const anhyst_pair anhyst_angles[89] = {{0.0, 0.0},
                                       {0x1.0fe66da9b94eep-5, -9.4294e-19},
                                       {0x1.2fdc4e3737dddp-5, -1.9405e-18},
                                       {0x1.4fcfd072dff79p-5, 2.4769e-18},
                                       {0x1.6fc0b4f27d5bbp-5, 2.3175e-19},
                                       {0x1.8faebc6b17abap-5, 2.9135e-18},
                                       {0x1.af99a7b3dd42fp-5, 2.8687e-18},
                                       {0x1.cf8137c90a177p-5, 3.2549e-18},
                                       {0x1.ef652dceca4dcp-5, -5.6699e-19},
                                       {0x1.0f99ea71d52a7p-4, -4.8859e-19},
                                       {0x1.2f719318a4a9ap-4, 1.3545e-19},
                                       {0x1.4f3fd677292fbp-4, 1.7385e-18},
                                       {0x1.6f03bdcea4b0dp-4, -1.0808e-18},
                                       {0x1.8ebc54478fb28p-4, 2.5151e-18},
                                       {0x1.ae68a71c722b8p-4, 3.0363e-18},
                                       {0x1.ce07c5c3cca32p-4, 1.8672e-18},
                                       {0x1.ed98c2190043bp-4, -5.3253e-19},
                                       {0x1.0e6adccf40882p-3, -1.2769e-17},
                                       {0x1.2dcbdb2fba1ffp-3, 5.4096e-18},
                                       {0x1.4d087a9da4f17p-3, 7.7845e-18},
                                       {0x1.6c1d4898933d9p-3, -4.0296e-18},
                                       {0x1.8b06ee2879c29p-3, -7.4146e-18},
                                       {0x1.a9c231b403279p-3, 7.3332e-18},
                                       {0x1.c84bf8a742e6ep-3, -5.4988e-18},
                                       {0x1.e6a148e96ec4dp-3, 1.0582e-17},
                                       {0x1.09dc597d86362p-2, 1.9239e-17},
                                       {0x1.278372057ef46p-2, -1.4284e-17},
                                       {0x1.44aa436c2af0ap-2, -1.8939e-17},
                                       {0x1.614840309cfe2p-2, -2.2939e-17},
                                       {0x1.7d5604b63b3f7p-2, 1.9612e-17},
                                       {0x1.98cd5454d6b18p-2, 2.2466e-17},
                                       {0x1.b3a911da65c6cp-2, 2.3316e-17},
                                       {0x1.cde53432c1351p-2, -2.2704e-17},
                                       {0x1.f40dd0b541418p-2, -1.1373e-17},
                                       {0x1.1255d9bfbd2a9p-1, -4.0638e-18},
                                       {0x1.2958e59308e31p-1, -1.4415e-17},
                                       {0x1.3f13fb89e96f4p-1, 2.6724e-17},
                                       {0x1.538f57b89061fp-1, -3.0761e-17},
                                       {0x1.66d663923e087p-1, -1.9876e-17},
                                       {0x1.78f6bbd5d315ep-1, 3.4739e-17},
                                       {0x1.89ff5ff57f1f8p-1, -3.7050e-17},
                                       {0x1.a1a25f2c82506p-1, -1.0715e-17},
                                       {0x1.bde70ed439fe7p-1, -2.2698e-17},
                                       {0x1.d6e57cf4f0acap-1, -4.0574e-17},
                                       {0x1.ed0d97c9041c9p-1, -3.9867e-18},
                                       {0x1.006132e34d617p+0, 9.4383e-17},
                                       {0x1.092ce471853ccp+0, 3.1943e-17},
                                       {0x1.110eb007f39f7p+0, -5.9566e-17},
                                       {0x1.1825f074030d9p+0, -5.4907e-18},
                                       {0x1.21862f3fade36p+0, 7.1238e-17},
                                       {0x1.2c1a241d66dc3p+0, 8.3852e-17},
                                       {0x1.34f1fbb19eb09p+0, 4.1725e-17},
                                       {0x1.3c6e650b38047p+0, 7.8798e-17},
                                       {0x1.42d70411f9ec1p+0, 3.2421e-17},
                                       {0x1.4861b4cfbe710p+0, -9.2832e-18},
                                       {0x1.4d378c1999a0dp+0, -1.2369e-17},
                                       {0x1.51784fa1544bap+0, -6.3194e-17},
                                       {0x1.56f6f33a3e6a7p+0, -2.5990e-17},
                                       {0x1.5d013c41adabdp+0, 1.0932e-16},
                                       {0x1.61f06c6a92b89p+0, -3.5615e-17},
                                       {0x1.660b02c736a06p+0, -2.3241e-17},
                                       {0x1.698213a9d5053p+0, -9.5738e-17},
                                       {0x1.6c78c7edeb195p+0, 8.7219e-17},
                                       {0x1.6f08f07435fecp+0, -4.3962e-17},
                                       {0x1.7145eac2088a4p+0, -1.1051e-16},
                                       {0x1.7424de90454d4p+0, -6.8188e-17},
                                       {0x1.77467e364f601p+0, -9.7113e-17},
                                       {0x1.79d0f3fad1c92p+0, 3.3876e-17},
                                       {0x1.7beb396c5699ap+0, -3.4455e-17},
                                       {0x1.7daff85a63058p+0, 6.2214e-17},
                                       {0x1.7f320a0f9f587p+0, 1.6960e-17},
                                       {0x1.807f2112987c7p+0, 6.0619e-17},
                                       {0x1.81a16e43f190bp+0, -1.0553e-16},
                                       {0x1.831516233f561p+0, -8.1783e-17},
                                       {0x1.84a99fe25186bp+0, 7.1405e-17},
                                       {0x1.85f14d43d81bep+0, 6.0651e-18},
                                       {0x1.87001c35928d4p+0, -9.4700e-17},
                                       {0x1.87e3aa32878aep+0, -8.9133e-17},
                                       {0x1.88a58ec949d14p+0, 9.3774e-17},
                                       {0x1.894cbdb6bedfcp+0, -1.7337e-18},
                                       {0x1.89de605acdbb3p+0, -1.0466e-16},
                                       {0x1.8a98bbf307aa8p+0, -1.0257e-16},
                                       {0x1.8b63797517bb5p+0, -4.8489e-17},
                                       {0x1.8c079f3350d26p+0, 8.4039e-17},
                                       {0x1.8c8f3c9e38564p+0, 1.0772e-16},
                                       {0x1.8d0129acd6d1cp+0, 3.8816e-17},
                                       {0x1.8d623796f0778p+0, 1.0306e-16},
                                       {0x1.8db5e3944965ep+0, 1.0364e-16},
                                       {0x1.8dfec478573a0p+0, 7.1264e-17}};

double anhyst_atan_f64(double x) { return anhyst_arctangent(x); }
